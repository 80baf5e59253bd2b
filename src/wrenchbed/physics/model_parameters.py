"""Parameters: what may differ between a robot and its model. Values never live in a parameter."""

import fnmatch
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from sys import float_info

import numpy as np

from wrenchbed.errors import ParameterError, did_you_mean

_PATTERNS = 4096
"""Size of the cache of pattern matches; MedRUE has 71 parameters (measured)."""


@dataclass(frozen=True)
class Parameter:
    """One scalar that may differ between a robot and its model; its value is kept elsewhere.

    Attributes:
        name: the field's or the paper's symbol, see ``docs/reference/nomenclature.md``.
        nominal: the value in the design [unit].
        unit: SI unit, for instance ``m``, ``rad``, ``kg``.
        tolerance: typical deviation of a real robot from nominal [unit]; scales the fit's columns.
        lower, upper: bounds [unit]; values outside are refused as impossible.
    """

    name: str
    nominal: float
    unit: str
    tolerance: float
    lower: float = -np.inf
    upper: float = np.inf
    text: str = ""


@dataclass(frozen=True)
class ParameterSet(Sequence[Parameter]):
    """Ordered parameters of a model, by index, name or pattern; converts vectors and mappings."""

    items: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        seen: set[str] = set()
        for item in self.items:
            if item.name in seen:
                raise ParameterError(f"parameter {item.name!r} is defined twice")
            seen.add(item.name)

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index):  # type: ignore[no-untyped-def]
        return self.items[index]

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.items)

    def __add__(self, other: "ParameterSet") -> "ParameterSet":
        return ParameterSet(self.items + other.items)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters in their order."""
        return tuple(p.name for p in self.items)

    @property
    def nominal(self) -> np.ndarray:
        """Nominal values ``(P,)``."""
        return np.array([p.nominal for p in self.items])

    @property
    def tolerance(self) -> np.ndarray:
        """Typical deviations of a real robot from nominal ``(P,)``."""
        return np.array([p.tolerance for p in self.items])

    def index(self, name: str) -> int:  # type: ignore[override]
        """Index of a parameter in the set by its name.

        Raises:
            ParameterError: no such parameter; the message suggests a close name.
        """
        try:
            return self.names.index(name)
        except ValueError:
            hint = did_you_mean(name, self.names) or f". Known: {', '.join(self.names)}"
            raise ParameterError(f"there is no parameter {name!r}{hint}") from None

    def select(self, patterns: Iterable[str]) -> tuple[int, ...]:
        """Indices of the parameters whose names match any pattern, in the set's order.

        A pattern is a name, a group (``tool.cog`` has ``tool.cog.x`` …) or a shell pattern
        (``L*``).

        Raises:
            ParameterError: a pattern matches nothing.
        """
        chosen: set[int] = set()
        for pattern in patterns:
            hits = _matching(self.names, pattern)
            if not hits:
                self.index(pattern)
            chosen |= hits
        return tuple(sorted(chosen))

    def vector(
        self, values: Mapping[str, float] | None = None, *, start: np.ndarray | None = None
    ) -> np.ndarray:
        """Values ``(P,)``: nominal (or ``start``), replaced by those in ``values``.

        Raises:
            ParameterError: an unknown name, a value that is not a finite number or out of bounds.
        """
        theta = (self.nominal if start is None else np.asarray(start, dtype=float)).copy()
        for name, value in (values or {}).items():
            i = self.index(name)
            self._check(self.items[i], value)
            theta[i] = value
        return theta

    def mapping(self, theta: np.ndarray) -> dict[str, float]:
        """Values by name, from a vector ``(P,)``."""
        return {p.name: float(v) for p, v in zip(self.items, theta, strict=True)}

    @staticmethod
    def _check(parameter: Parameter, value: float) -> None:
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not plain or not abs(value) <= float_info.max:
            raise ParameterError(
                f"parameter {parameter.name} = {value!r:.40} is not a finite number"
            )
        if not parameter.lower <= value <= parameter.upper:
            unit = parameter.unit
            other = {"m": " (is it in mm?)", "rad": " (is it in degrees?)"}.get(unit, "")
            raise ParameterError(
                f"parameter {parameter.name} = {value:g} {unit} lies outside "
                f"{parameter.lower:g} … {parameter.upper:g} {unit}{other}"
            )


@lru_cache(_PATTERNS)
def _matching(names: tuple[str, ...], pattern: str) -> frozenset[int]:
    """Indices of the names that a pattern matches: a name, a group (``tool.cog``), or a shell
    pattern."""
    return frozenset(
        i
        for i, name in enumerate(names)
        if fnmatch.fnmatchcase(name, pattern) or name.startswith(pattern + ".")
    )
