"""The memory that a verb needs, asked before libraries are loaded.

Libraries of linear algebra wait for ever, or end the process, where the address space is too
small for them.
"""

import os
import resource

from wrenchbed.errors import ShortageError

_GB = 1e9
_LEAST = 1.2e9
"""Address space below which libraries fail to load, or wait for ever [bytes]; measured on two
cores."""
_LEAST_DRAWN = 4.5e9
"""The same for verbs that load rerun, which reserves much and uses little [bytes]."""
_DRAWN = ("diagnose", "view")


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
