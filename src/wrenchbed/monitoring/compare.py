"""What changed between two fits, recordings or diagnoses of one robot, and by how many σ.

A number counts as changed at the level 1 % over all compared numbers (Holm 1979, Scandinavian
Journal of Statistics 6, 65–70). All together are judged by d' (C_a + C_b)⁻¹ d, which is χ² where
nothing changed; d are the differences, C the covariances.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtrc, stdtr, stdtrit  # scipy.stats takes a second to load

from wrenchbed.calibration.calibrate import CalibrationOptions, calibrate
from wrenchbed.data.overwrite_rules import Kind, kind_of
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.files import checked
from wrenchbed.pages import ReportPage
from wrenchbed.pages.document import provenance
from wrenchbed.pages.numbers import decimals, human, minus, p_value, with_unit
from wrenchbed.physics.wrench import CHANNELS

LEVEL = 0.01
"""Probability that any number is called changed where none did."""
MISFIT_GROWS = 3.0
"""Least ratio of both misfits that is a change: that of 24 healthy poses of a UR5 reaches 1.6."""
_KINDS = {"a fit": "fits", "a recording": "recordings"}
_UNEXPLAINED = "what these numbers do not explain went from {:.1f} to {:.1f} times the noise"
_GROWN = f"{_UNEXPLAINED}; it counts from {MISFIT_GROWS:g} times on."
_SUSPECTS = "a joint, the base, a cable or a contact may have changed, see `wrenchbed diagnose`"
_SINGULAR = 1e-10
"""Relative eigenvalue below which a combination of numbers is not determined by both fits."""


@dataclass(frozen=True)
class Change:
    """Change of one number between two results.

    Attributes:
        name, unit: name and unit of the number, as in the files.
        before, after: values [unit].
        std: standard uncertainty of their difference [unit].
        sigmas: difference / std.
        changed: whether the change is significant, with all compared numbers considered.
    """

    name: str
    unit: str
    before: float
    after: float
    std: float
    sigmas: float
    changed: bool = False

    @property
    def size(self) -> float:
        """Absolute difference between both values, in standard uncertainties of that difference."""
        return abs(self.sigmas)

    @property
    def cells(self) -> tuple[str, ...]:
        """Table cells: name, both values and difference ± its std, all in one unit with as many
        decimals, difference in σ."""
        step = self.after - self.before
        factor, unit = human(self.name, step, self.unit)
        form = f".{decimals(factor * self.std)}f"
        before, after, std = (f"{factor * x:{form}}" for x in (self.before, self.after, self.std))
        texts = before, after, f"{factor * step:+{form}} ± {std}"
        return self.name, *(minus(with_unit(x, unit)) for x in texts), minus(f"{self.sigmas:+.1f}")

    @property
    def sentence(self) -> str:
        """Text of the change for people, such as ``tool.mass: +12.3 ± 0.4 g (31 σ)``."""
        return f"{self.name}: {self.cells[3]} ({self.size:.1f} σ)"


@dataclass(frozen=True)
class Comparison:
    """Result of comparing two fits, recordings or diagnoses.

    Attributes:
        kind: ``fits``, ``recordings`` or ``diagnoses``.
        a, b: names of the two.
        changes: every number that both determine.
        together: χ², degrees of freedom and p of all numbers at once; None of diagnoses.
        left: sentences on what could not be compared, and why.
        sentences: summary for people, the most important first.
        changed: whether anything changed.
        decides: the figure that decides, as ``4.1 σ``, and a sentence with the limit from which it
            counts; both empty where no number is compared.
    """

    kind: str
    a: str
    b: str
    changes: tuple[Change, ...]
    together: Mapping[str, float] | None
    left: tuple[str, ...]
    sentences: tuple[str, ...]
    changed: bool
    decides: tuple[str, str] = ("", "")

    def to_json(self) -> dict[str, Any]:
        """Convert to a JSON object, as `wrenchbed compare --json` prints it."""
        return asdict(self)

    def page(self, command: str = "", **more: Any) -> ReportPage:
        """HTML page with the ``command`` line; ``more`` replaces values of its template by name."""
        values = {
            "c": self, "word": "changed" if self.changed else "no change", "latest": self.b,
            "together": p_value(self.together["p"]) if self.together else "", "command": command,
            "data": provenance([_file(Path(name)) for name in (self.a, self.b)]),
        }  # fmt: skip
        return ReportPage(values | more, "comparison.html")


def compare(a: str | Path, b: str | Path) -> Comparison:
    """Compare two files of one kind: fit.json, diagnosis.json (or its folder), or recordings.

    Recordings are calibrated first, with the robot's default parameters; a `CalibrationError` if
    one cannot be. A `ParameterError` if the files are of different kinds or robots, or one is of
    none of these kinds.
    """
    (kind, first), (other, second) = _read(Path(a)), _read(Path(b))
    if kind != other:
        raise ParameterError(f"{a} is {kind} and {b} is {other}: compare two of one kind")
    robots = [fields.raw.get("robot") for fields in (first, second)]
    if robots[0] != robots[1]:
        raise ParameterError(f"{a} is of robot {robots[0]!r}, {b} of {robots[1]!r}")
    if kind == "a diagnosis":
        return _of_diagnoses((first, second), (str(a), str(b)))
    return _of_fits((first, second), (str(a), str(b)), _KINDS[kind])


def _read(path: Path) -> tuple[str, checked.Fields]:
    """Read a file to compare: its kind, and its JSON fields (of a recording, those of its fit)."""
    path = _file(path)
    if not path.is_file():
        raise ParameterError(f"{path}: there is no such file")
    if path.suffix == ".parquet" or kind_of(path) == Kind.RECORDING:
        raw: Any = calibrate(Recording.read(path), CalibrationOptions()).to_json()
        return "a recording", checked.Fields(raw, f"{path}: ", ParameterError)
    raw = checked.load(path, ParameterError)
    kinds = {"a fit": {"parameters", "covariance"}, "a diagnosis": {"verdict", "gap"}}
    for kind, fields in kinds.items():
        if isinstance(raw, dict) and fields <= raw.keys():
            return kind, checked.Fields(raw, f"{path}: ", ParameterError)
    raise ParameterError(f"{path}: is no recording, fit or diagnosis")


def _file(path: Path) -> Path:
    """Path of the file to compare; for the folder of a diagnosis, that of its diagnosis.json."""
    return path / "diagnosis.json" if (path / "diagnosis.json").is_file() else path


def _of_fits(fits: Sequence[checked.Fields], names: tuple[str, str], kind: str) -> Comparison:
    """Compare the parameters of two fits by their σ; ``names``: the files, ``kind``: fits or
    recordings."""
    entries = [{n: f.part("parameters").part(n) for n in f.part("parameters").raw} for f in fits]
    stated = ("value", "std")
    known = [
        {n for n, e in each.items() if None not in [e.number(field, "") for field in stated]}
        for each in entries
    ]
    both = [n for n in entries[0] if n in known[0] & known[1]]
    uncompared, sentences = list[str](), list[str]()
    for k, (fit, name) in enumerate(zip(fits, names, strict=True)):
        uncompared += [f"{n}: only in {name}" for n in entries[k] if n in known[k] - known[1 - k]]
        fixed = (n for n in entries[k] if n not in known[k])
        uncompared += [f"{n}: {name} fixes it only in combination with others" for n in fixed]
        if fit.raw.get("refuted"):
            sentences.append(f"{name} is refuted by its own data: {fit.raw['refuted']}")
    if not both:
        raise ParameterError(f"{names[0]} and {names[1]} determine no number in common")
    before, after = (np.array([each[n].number("value", "") for n in both]) for each in entries)
    covariance = _covariance(fits[0], both) + _covariance(fits[1], both)
    units = {n: str(entries[0][n].raw.get("unit")) for n in both}
    changes = changes_of(units, before, after, np.sqrt(np.diagonal(covariance)))
    together = _together(after - before, covariance)
    recordings = [fit.raw.get("recording") for fit in fits]
    if kind == "fits" and recordings[0] == recordings[1]:
        shared = "fits of the same rows share their noise, and σ is then too large"
        sentences.insert(0, f"both are of {recordings[0]}: {shared}")
    moved, left = any(c.changed for c in changes), [*map(_misfit, fits)]
    changed, decides = moved or together["p"] < LEVEL, largest(changes)
    if changed and not moved:
        decides = (
            f"p {p_value(together['p'])}",
            f"All numbers together: a change below p {LEVEL:g}.",
        )
    if grown := max(left) >= MISFIT_GROWS * min(left):
        sentences[:0] = [_UNEXPLAINED.format(*left), _SUSPECTS]
        if not moved:
            decides = f"{max(left) / min(left):.1f} ×", _GROWN.format(*left)
    if changed or not grown:
        sentences.insert(0, _headline(changes, together))
    texts = tuple(uncompared), tuple(sentences)
    return Comparison(kind, *names, changes, together, *texts, changed or grown, decides)


def _misfit(fit: checked.Fields) -> float:
    """Largest ratio of what a fit leaves of poses' means in a channel to noise, at least 1."""
    noise = fit.raw.get("noise") or {}
    expected, scatter = (noise.get(f"hold_mean_{k}") or {} for k in ("expected", "scatter"))
    return max([1.0, *(scatter[c] / expected[c] for c in CHANNELS if expected.get(c))])


def changes_of(
    units: Mapping[str, str],
    before: np.ndarray,
    after: np.ndarray,
    std: np.ndarray,
    *,
    level: float = LEVEL,
    freedom: float = np.inf,
) -> tuple[Change, ...]:
    """Changes of K numbers (name → unit) from ``before`` to ``after`` (K,), each judged significant
    or not.

    Standard uncertainties ``std`` (K,) of the differences and Student's t with ``freedom`` decide;
    ``level`` is the probability that any is called changed where none did.
    """
    difference = after - before
    sigmas = np.divide(difference, std, out=np.zeros(len(std)), where=std > 0)
    sigmas[(std == 0) & (difference != 0)] = np.inf
    changed = holm(2.0 * stdtr(freedom, -np.abs(sigmas)), level)
    columns = (x.tolist() for x in (before, after, std, sigmas, changed))
    each = zip(units.items(), *columns, strict=True)
    return tuple(Change(*number, *values) for number, *values in each)


def _covariance(fields: checked.Fields, names: Sequence[str]) -> np.ndarray:
    """Covariance (K, K) of the named parameters, from a fit's fields."""
    known = list(fields.raw["parameters"])
    at = [known.index(n) for n in names]
    return np.array(fields.square("covariance", len(known)))[np.ix_(at, at)]


def _together(difference: np.ndarray, covariance: np.ndarray) -> dict[str, float]:
    """χ², degrees of freedom and p of differences (K,) with a covariance (K, K), in JSON form."""
    scale = np.sqrt(np.diagonal(covariance))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > _SINGULAR * values[-1]
    turned = vectors.T @ (difference / scale)
    chi2 = float(np.sum(turned[kept] ** 2 / values[kept]))
    return {"chi2": chi2, "dof": int(kept.sum()), "p": float(chdtrc(kept.sum(), chi2))}


def holm(p: np.ndarray, level: float = LEVEL) -> np.ndarray:
    """Booleans (K,): which of K p values are significant; ``level``: probability of any error."""
    order = np.argsort(p)
    steps = p[order] <= level / np.arange(len(p), 0, -1)
    passed = np.zeros(len(p), dtype=bool)
    passed[order] = np.cumprod(steps).astype(bool)
    return passed


def largest(
    changes: Sequence[Change], level: float = LEVEL, freedom: float = np.inf
) -> tuple[str, str]:
    """Text of the largest difference in σ, and a sentence that names it and the limit from which it
    counts at a ``level``, by Student's t with ``freedom``; empty without changes."""
    if not changes:
        return "", ""
    most, limit = max(changes, key=lambda c: c.size), stdtrit(freedom, level / (2 * len(changes)))
    text = f"{most.name}, which as the largest of {len(changes)} counts from {-limit:.1f} σ on."
    return f"{most.size:.1f} σ", f"Largest difference: {text}"


def significant(changes: Sequence[Change]) -> list[str]:
    """Sentences on the significant ones of some changes, the largest in σ first."""
    return [c.sentence for c in sorted(changes, key=lambda c: -c.size) if c.changed]


def _headline(changes: Sequence[Change], together: Mapping[str, float]) -> str:
    p = p_value(together["p"])
    if changed := significant(changes):
        return f"{len(changed)} of {len(changes)} numbers changed: {'; '.join(changed)}"
    if together["p"] < LEVEL:
        return f"no number changed by itself, but all {len(changes)} together did (p {p})"
    return f"no change: {len(changes)} numbers agree (p {p} of all together)"


def _of_diagnoses(fields: Sequence[checked.Fields], names: tuple[str, str]) -> Comparison:
    """Compare two diagnoses by verdict, causes, gap and numbers."""
    verdicts = [str(f.raw["verdict"]) for f in fields]
    causes = [{str(w.raw.get("effect")): w for w in f.parts("which")} for f in fields]
    sentences = [] if verdicts[0] == verdicts[1] else [f"verdict: {' → '.join(verdicts)}"]
    sentences += [f"{n}: named → not named" for n in causes[0] if n not in causes[1]]
    sentences += [f"{n}: not named → named" for n in causes[1] if n not in causes[0]]
    gaps = [f.part("gap") for f in fields]
    ends = [g.numbers("calibrated_ci95", 2) for g in gaps]
    if ends[0] and ends[1] and (ends[0][1] < ends[1][0] or ends[1][1] < ends[0][0]):
        values = [g.number("calibrated", "") or 0.0 for g in gaps]
        sentences.append(f"gap after calibration: {values[0]:.3g} → {values[1]:.3g}")
    units, numbers = dict[str, str](), list[list[float]]()
    for effect in (n for n in causes[0] if n in causes[1]):
        parts = [c[effect].part("parameters") for c in causes]
        for name in (n for n in parts[0].raw if n in parts[1].raw):
            entries = [p.part(name) for p in parts]
            stated = [e.number(field, "") for field in ("value", "std") for e in entries]
            if len(known := [x for x in stated if x is not None]) == len(stated):
                units[f"{effect} {name}"] = str(entries[0].raw.get("unit", ""))
                numbers.append(known)
    before, after, *std = np.array(numbers).reshape(-1, 4).T
    changes = changes_of(units, before, after, np.hypot(*std))
    sentences += [c.sentence for c in changes if c.changed]
    same = f"no change: both {verdicts[0]}, the same causes, {len(changes)} numbers agree"
    texts, decides = tuple(sentences or [same]), largest(changes)
    if sentences and not any(c.changed for c in changes):
        decides = "No number", "Verdict, causes or gap differ, as stated above."
    return Comparison("diagnoses", *names, changes, None, (), texts, bool(sentences), decides)
