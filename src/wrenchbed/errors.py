"""The classes of all errors that wrenchbed raises on purpose; each is a built-in kind too.

A message is one line. It names the file, field and row, the value and the remedy. File names and
values of foreign files stand in it, so characters that a terminal would obey are spelled out. Class
names are public (docs/reference/python.md); `scripts/messages` lists the texts.
"""

import errno
import re
from collections.abc import Collection
from difflib import get_close_matches
from pathlib import Path

OBEYED = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff"
    "\ufffe\uffff\ud800-\udfff\U000e0000-\U000e007f]"
)
"""Characters that a terminal may obey or hide: control characters but tab and line feed, marks that
turn the direction of writing, characters without a width, noncharacters, and lone surrogates (file
names that are not UTF-8)."""
_LONGEST_WORD, _LONGEST_LINE = 1000, 4000
"""Longest word and message [characters]; longer ones are cut. A path has at most 255 characters a
part, and a list of all parameters 2,000."""
_FILES = {errno.EMFILE, errno.ENFILE}
_UNLOADED = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory")
"""Messages of the dynamic linker where a library does not fit into memory: glibc's dl-load.c."""


def printable(text: str) -> str:
    r"""Return the text with control characters spelled out (``\x1b``); line feeds and tabs stay."""
    return OBEYED.sub(lambda m: m[0].encode("unicode_escape").decode(), text)


def one_line(text: str) -> str:
    """Return the text as one line without control characters; a very long one is cut."""

    def cut(found: re.Match[str]) -> str:
        return f"{found[0][:200]}… ({len(found[0]):,} characters)"

    text = re.sub(rf"\S{{{_LONGEST_WORD + 1},}}", cut, text)
    if len(text) > _LONGEST_LINE:
        text = f"{text[: _LONGEST_LINE // 2]} … ({len(text):,} characters) … {text[-500:]}"
    return printable(text).replace("\n", "\\n").replace("\t", "\\t")


def did_you_mean(word: str, known: Collection[str]) -> str:
    """Text ``; did you mean 'this'?`` if a known word is close, else ""."""
    close = get_close_matches(str(word), list(known), 1)
    close = close or [k for k in known if len(str(word)) > 2 and k.startswith(str(word))]
    return f"; did you mean {close[0]!r}?" if close else ""


class WrenchbedError(Exception):
    """Base of all errors of wrenchbed; the command line prints it as one line and exits with 1."""

    def __str__(self) -> str:
        return one_line(super().__str__())


class ParameterError(WrenchbedError, ValueError):
    """A parameter that does not exist, or a value outside its bounds."""


class RecordingError(WrenchbedError, ValueError):
    """A recording that is unreadable, truncated, mislabelled or holds impossible values."""


class PlanError(WrenchbedError, ValueError):
    """A plan that leaves the robot's limits or does not fit the robot."""


class MapError(WrenchbedError, ValueError):
    """A column map that is incomplete, contradicts itself or does not fit its files."""


class KinematicsError(WrenchbedError, ValueError):
    """Joint values or poses at which the robot's equations have no solution."""


class CalibrationError(WrenchbedError, ValueError):
    """A recording that cannot support the requested calibration."""


class DiagnosisError(WrenchbedError, ValueError):
    """A recording that cannot show where its sim-to-real gap comes from, whatever the cause."""


class TwinError(WrenchbedError, ValueError):
    """A corrected simulator's file that is invalid, or a motion its robot cannot follow."""


class ExportError(WrenchbedError, ValueError):
    """Values to export that the data did not determine, or a file that cannot take them."""


class BenchmarkError(WrenchbedError, ValueError):
    """Benchmark cases, answers or hashed claims that are missing, were changed or do not match."""


class HistoryError(WrenchbedError, ValueError):
    """A history of checks that is damaged, out of order, or of another robot."""


class FleetError(WrenchbedError, RuntimeError):
    """Work on many simulated robots that broke off, or another run's folder; results are kept."""


class WorkerError(WrenchbedError, RuntimeError):
    """A worker process that was killed, crashed or could not start."""


class ShortageError(WrenchbedError, RuntimeError):
    """This process lacks memory or may open too few files; no input file is to blame."""


class NotFoundError(WrenchbedError, LookupError):
    """A plug-in that does not exist."""


class DriverError(WrenchbedError, RuntimeError):
    """A device that did not execute a command."""


class LinkError(DriverError, ConnectionError):
    """A device that is silent, unreachable or disconnected; nothing moves until it is back."""


class StoppedError(DriverError):
    """A robot that stopped by itself: protective or emergency stop, program ended, power off."""


class SafetyStopError(StoppedError):
    """A robot that stopped to protect itself or people; a person must look before it goes on."""


class LimitError(DriverError, ValueError):
    """A command, or a measured wrench, beyond the limits that the driver was given."""


class LateError(DriverError, TimeoutError):
    """A command that a device, which answers, had not finished by its deadline."""


class MissingExtraError(WrenchbedError, ImportError):
    """An optional library is not installed; the message names the extra."""


class WrenchbedWarning(UserWarning):
    """Warning of something that a person should know; the work continues."""


def shortage(cause: BaseException, where: str | Path = "") -> ShortageError | None:
    """The `ShortageError` for an error about too little memory or too few files, else None.

    Args:
        cause: any error, for instance of a reader.
        where: file that was being read or written, if any.
    """
    place = f"{where}: " if where else ""
    number = cause.errno if isinstance(cause, OSError) else None
    named = isinstance(cause, OSError) and bool(cause.filename)
    unloaded = isinstance(cause, ImportError) and any(t in str(cause) for t in _UNLOADED)
    # EAGAIN with a file's name is a lock that another process holds
    lacking = number == errno.ENOMEM or (number == errno.EAGAIN and not named)
    if isinstance(cause, MemoryError) or lacking or unloaded:
        return ShortageError(
            f"{place}out of memory: free some, raise the limit (`ulimit -v unlimited`), use fewer "
            "processes, or give shorter recordings"
        )
    if number in _FILES:
        return ShortageError(
            f"{place}too many open files: raise the limit (`ulimit -n 1024`), or use fewer "
            "processes"
        )
    return None


def raise_shortage(cause: BaseException, where: str | Path = "") -> None:
    """Raise `ShortageError` if ``cause`` is about too little memory or too few files, while
    ``where`` was read: no file is to blame."""
    error = shortage(cause, where)
    if error is not None:
        raise error from cause
