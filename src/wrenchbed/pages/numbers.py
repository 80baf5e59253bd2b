"""Numbers as people read them: as many digits as are known, with their unit.

One rule for units on pages, in the terminal and in rerun: those of `HUMAN`, small values in those
of `_SMALL`, shares in %; every other unit is SI. Files hold SI alone.
"""

import math
import re
from collections.abc import Mapping
from typing import Any

NORMAL_95 = 1.96
"""Half the width of a 95 % interval, in standard uncertainties."""
MOST_NINES = 4
"""Most decimals of a percentage just below 100 %."""
HUMAN: Mapping[str, tuple[str, float]] = {
    "m": ("mm", 1e3), "rad": ("°", 180.0 / math.pi), "kg·m²": ("g·m²", 1e3),
    "N/s": ("N/h", 3600.0), "N·m/s": ("N·m/h", 3600.0), "m/s": ("mm/min", 6e4),
    "kg/s": ("g/min", 6e4), "1/s": ("%/h", 3.6e5), "1/K": ("%/K", 1e2),
    "rad/(N·m)": ("µrad/(N·m)", 1e6), "m/N": ("µm/N", 1e6),
}  # fmt: skip
"""Units that people read instead of SI units, and the factor to them."""
_SMALL = {"s": ("ms", 0.1), "kg": ("g", 0.1), "N": ("mN", 0.01), "N·m": ("mN·m", 0.01)}
"""Thousandths of SI units, and the value below which people read them."""
_CROSSTALK = {"1": ("%", 1e2), "1/m": ("N/(N·m)", 1.0), "m": ("mN·m/N", 1e3)}
"""Units of ``x.fz.ty``: what channel fz shows of the load on ty."""
_SHARES = ("gain", "share", "span", "warm", "relax", "even", "odd", "size")
"""Starts of the names of parameters without unit that people read in percent."""
POWERS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
"""Digits as exponents."""


def gap(value: float) -> str:
    """Text of a gap (mean squared residual over a row's noise variance, less 1): two decimals or
    fewer; 0.00 where less than the noise is left."""
    value = max(0.0, value)  # of −0.0 too
    return f"{value:,.{2 if value < 10 else 1 if value < 100 else 0}f}"


def percent(x: float) -> str:
    """Text of a ratio in %: one decimal, none from 1,000 % on, more just below 100 %."""
    rest = 1.0 - x
    if 0.0 < rest < 1e-3:
        digits = min(MOST_NINES, -math.floor(math.log10(rest)) - 2)
        scale = 10.0**digits
        return f"{math.floor(100 * x * scale) / scale:.{digits}f}"
    return minus(f"{100 * x:,.0f}" if abs(x) >= 10 else f"{100 * x:.1f}")


def chance(p: float) -> str:
    """Text of a probability with two decimals, ``> 0.99`` and ``< 0.01`` at the ends."""
    return ">\u00a00.99" if p > 0.994 else "<\u00a00.01" if p < 0.006 else f"{p:.2f}"


def p_value(p: float) -> str:
    """Text of a p-value with one or two significant figures."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.0995 else f"{p:.2f}"


def quantity(name: str, entry: Mapping[str, Any], *, signed: bool = False) -> str:
    """Text ``value ± std unit`` of parameter ``name``, from its JSON ``entry``; with "+" if
    ``signed``."""
    value, std = entry.get("value"), entry.get("std")
    if not _is_number(value) or "unit" not in entry:
        shown, rivals = f"{value:g}" if _is_number(value) else str(value), entry.get("rivals")
        *others, last = map(str, sorted([value, *rivals])) if rivals else [shown]
        return f"{', '.join(others)} or {last}" if others else last
    factor, unit = human(name, value or 0.0, str(entry["unit"]))
    spread = None if std is None else factor * float(std)
    shown = measured(factor * float(value or 0.0), spread, signed=signed)
    return with_unit(shown, unit)


def rough(name: str, value: float, unit: str, like: float | None = None) -> str:
    """Text of a size [``unit``] with two significant figures, in the unit that suits ``like``."""
    factor, shown = human(name, value if like is None else like, unit)
    return minus(with_unit(f"{float(f'{factor * value:.2g}'):g}", shown))


def measured(value: float, std: float | None, *, signed: bool = False) -> str:
    """Text of a value with as many digits as its std allows: ``(1.40 ± 0.05)·10⁴``; "+" if
    ``signed``."""
    if not math.isfinite(value):
        return "–"
    plus = "+" if signed and value > 0 else ""
    known = std is not None and math.isfinite(std) and std > 0
    power = _power(max(abs(value), std or 0.0) if known else abs(value))
    value, times = value / 10.0**power, f"·10{str(power).translate(POWERS)}" if power else ""
    if not known or std is None:
        return minus(f"{plus}{value:.4g}{times}")
    std = std / 10.0**power
    lead = math.floor(math.log10(std))  # two figures if it begins with 1 or 2, else one
    digits = min(6, max(0, -lead + (std / 10.0**lead < 2.95)))
    both = minus(f"{plus}{value:.{digits}f} ± {max(std, 10.0**-digits):.{digits}f}")
    return f"({both}){times}" if power else both


def decimals(std: float) -> int:
    """Number of decimals with which a standard uncertainty keeps two figures."""
    return int(min(9, max(0, 1 - math.floor(math.log10(std))))) if std > 0 else 9


def round_down(x: float) -> float:
    """Largest number of the form 1, 2 or 5 times a power of ten that is not above x > 0."""
    power = 10.0 ** math.floor(math.log10(x))
    return float(f"{max(s for s in (1.0, 2.0, 5.0) if s * power <= x * (1 + 1e-9)) * power:.3g}")


def minus(text: str) -> str:
    """Replace the hyphen of a negative number by a minus sign; "-0" and "+0" become "0"."""
    return re.sub(r"[-+](?=0(\.0*)?(?![\d.]))", "", text).replace("-", "−")


def human(name: str, value: float, unit: str) -> tuple[float, str]:
    """(factor, unit) in which people read ``value`` [``unit``]; ``name`` decides whether a ratio is
    in %."""
    if unit == "1" and name == "skew":
        return 1e6, "ppm"
    if unit == "1" and not name.startswith("x."):
        return (100.0, "%") if name.split(".")[0] in _SHARES else (1.0, "")
    small, most = _SMALL.get(unit, (unit, 0.0))
    if abs(value) < most:
        return 1e3, small
    shown, factor = (_CROSSTALK if name.startswith("x.") else HUMAN).get(unit, (unit, 1.0))
    return factor, shown


def with_unit(number: str, unit: str) -> str:
    """Join number and unit to a text; only the degree sign follows without a space."""
    return number + unit if unit == "°" else f"{number} {unit}".rstrip()


def _power(size: float) -> int:
    """Power of ten to write as a factor beside a number; 0 where a plain number reads well."""
    return 0 if size == 0.0 or 1e-3 <= size < 1e4 else math.floor(math.log10(size))


def _is_number(x: object) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool)
