"""Messages as rows of numbers: fields by their path, times as whole nanoseconds."""

from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pyarrow as pa

STAMP, LOGGED = "stamp", "logged"
"""Times of a message: its header's, and when it was written [ns]."""
Getter = Callable[[Any], float]


class Rows:
    """Some fields of messages of one topic, gathered one by one.

    Args:
        wanted: names of columns: `STAMP`, `LOGGED`, a path such as ``wrench.force.x``, or, of
            messages with names (JointState), ``position.<joint>``.
    """

    def __init__(self, wanted: Sequence[str]) -> None:
        self.wanted = tuple(dict.fromkeys(wanted))
        self.missing: set[str] = set()
        self._times = {n: array("q") for n in self.wanted if n in (STAMP, LOGGED)}
        self._values = {n: array("d") for n in self.wanted if n not in (STAMP, LOGGED)}

    def add(self, message: Any, logged: int) -> None:
        """One message."""
        if LOGGED in self._times:
            self._times[LOGGED].append(logged)
        if STAMP in self._times:
            at = _get(_get(message, "header"), "stamp")
            self._times[STAMP].append(_nanoseconds(at))
        names = _get(message, "name") if "." in "".join(self._values) else None
        for column, values in self._values.items():
            values.append(self._value(message, column, names))

    def table(self) -> pa.Table:
        """What was gathered; fields that some message lacked are NaN."""
        columns = {n: pa.array(memoryview(v), pa.int64()) for n, v in self._times.items()}
        columns |= {n: pa.array(memoryview(v), pa.float64()) for n, v in self._values.items()}
        return pa.table({n: columns[n] for n in self.wanted})

    def _value(self, message: Any, column: str, names: Any) -> float:
        found: Any = message
        parts = column.split(".")
        for depth, part in enumerate(parts):
            inner = _get(found, part)
            if inner is None and names is not None and _listed(found):
                joint = ".".join(parts[depth:])
                inner = found[list(names).index(joint)] if joint in list(names) else None
                found = inner
                break
            found = inner
            if found is None:
                break
        if isinstance(found, bool | int | float) or hasattr(found, "__float__"):
            return float(found)
        self.missing.add(column)
        return float("nan")


def _get(thing: Any, name: str) -> Any:
    if isinstance(thing, Mapping):
        return thing.get(name)
    if _listed(thing):
        return thing[int(name)] if name.isdecimal() and int(name) < len(thing) else None
    return getattr(thing, name, None)


def _listed(thing: Any) -> bool:
    return (
        hasattr(thing, "__len__")
        and hasattr(thing, "__getitem__")
        and not isinstance(thing, str | Mapping)
    )


def _nanoseconds(stamp: Any) -> int:
    """Of ROS 1 or 2, or JSON; −1 without one."""
    if stamp is None:
        return -1
    second = _get(stamp, "sec")
    part = _get(stamp, "nanosec")
    if part is None:
        part = _get(stamp, "nsec")
    return -1 if second is None or part is None else int(second) * 1_000_000_000 + int(part)
