"""What must be settled before libraries are loaded: the memory of a verb, and the terminal.

Libraries of linear algebra wait for ever, or end the process, where the address space is too
small for them. Output is written on any terminal: of few columns, and of encodings that lack some
characters.
"""

import io
import os
import resource
import shutil
import sys

from wrenchbed.errors import ShortageError

_GB = 1e9
_LEAST = 1.2e9
"""Address space below which libraries fail to load, or wait for ever [bytes]; measured on two
cores."""
_LEAST_DRAWN = 4.5e9
"""The same for verbs that load rerun, which reserves much and uses little [bytes]."""
_DRAWN = ("diagnose", "view")
LEAST_COLUMNS = 40
"""The narrowest output; below, tyro's layout of help does not end (tyro 1.0)."""


def check_memory(verb: str) -> None:
    """Refuse an address space that is limited below what a verb needs.

    A limited process also loads its linear algebra with one thread: each reserves memory.

    Raises:
        ShortageError: names the limit, the need and the remedy.
    """
    need = _LEAST_DRAWN if verb in _DRAWN else _LEAST
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return
    if limit < need:
        raise ShortageError(
            f"out of memory: this process may use {limit / _GB:.2g} GB of address space and needs "
            f"{need / _GB:.2g} GB: raise the limit (`ulimit -v {round(need / 1024)}`)"
        )
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def prepare() -> None:
    """Let standard output and error write everything, on at least `LEAST_COLUMNS` columns."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if shutil.get_terminal_size().columns < LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(LEAST_COLUMNS)


def lacks(text: str) -> bool:
    """Whether standard output lacks characters of a text."""
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "ascii")
    except UnicodeEncodeError:
        return True
    return False
