"""One look-alike: what is wrong with the robot, how much it shows, and its recording.

Every case has a little of most effects. Noise of rows has heavy tails, memory, correlation between
channels and a slow wander. The gap of a change is its mean square over the noise variance, after a
fit of bias, mass and CoG. Thresholds with a margin, the growth of sizes, ranges of noise and
typical sizes are estimates; see docs/explanation/benchmark.md.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.signal import lfilter

from wrenchbed.benchmark import fault as common
from wrenchbed.benchmark.fault import STATED, Rng, between, log_uniform, possible
from wrenchbed.benchmark.lookalikes import faults, faults_outside_library, imperfection
from wrenchbed.benchmark.lookalikes.experiment_design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, ImperfectRobot, Scaled
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS

Draw = Callable[..., Imperfection]
"""Draws an imperfection for a design with a generator; an effect's ``size`` is in multiples of the
typical one."""
DRAWS: dict[str, Draw] = common.draws(faults)
"""Draws of the library's effects by name."""
FAMILIES: dict[str, Draw] = common.draws(faults_outside_library, mark="_")
"""Draws of families outside every library, by name."""
_BY_JOINTS = ("gas_spring", "magnet")
"""Families that only robots with joints have."""
LARGEST = 8.0
"""Largest size of a cause in multiples of the typical one."""
_PROBES = 4
"""Draws that find out whether a design shows an effect."""
_PROBED_GAP = 1.3
"""Gap that one of the `_PROBES` draws must reach: above the 1 that counts, so that a case of it is
no matter of chance."""
SMALLEST_BACKGROUND, LARGEST_BACKGROUND = 0.02, 0.45
"""Range of the gap that all small imperfections make together."""
MOST_RISE = 0.25
"""Rise of a channel's row variance by the background's vibration, at most."""
_HARD = (
    "tool.inertia", "tool.loose", "tool.flexure", "joint.compliance", "joint.backlash",
    "joint.gear_error", "joint.clearance", "base.compliance", "sensor.creep",
)  # fmt: skip
"""Effects that often show too little: whether they can is tried out once for each design."""
LEAST_REPEATS = 4
"""Rows of a hold from which the scatter of rows shows: three degrees of freedom."""
_LEAST_RISE = 0.5
"""Range of a temperature [K] below which it shows nothing: some counts of a thermometer."""
_NOT_IN_BACKGROUND = (*STATED, "sensor.saturation", "environment.contact", "timing.stale")
_PRESENT = 0.7
"""Probability of each effect to be in the background."""
_SCALINGS = 6
"""Largest number of scalings of a background."""
_TRIES = 10
"""Largest number of draws of one effect."""
_EFFECT_TRIES = 12
"""Largest number of effects that are tried."""
_MARGIN = 1.25
"""Factor on the needed gap when a size grows."""
WANDER = 0.3
"""Largest rms of the wander between holds in noises of one row: a gap below 0.1."""
_ENCODER = 4e-6
"""Standard deviation of joint readings at rest [rad or m], the count of an encoder of 20 to 21 bits
a turn; a hundredth of it in motion, where derivatives of the readings amplify it. Estimate."""


@lru_cache(maxsize=8)
def effects(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the effects that can be drawn for a design, as its readings can reveal them."""
    return tuple(n for n in _fitting(design) if n not in _HARD or _shows(design, n))


def _fitting(design: ExperimentDesign) -> list[str]:
    """Names of the effects whose `CaseEffect.needs` a design meets."""
    warm = design.temperature
    met = {
        "motion": design.moving,
        "joints": bool(design.robot.joints),
        "loops": bool(design.distal_links),
        "warmth": warm is not None and np.ptp(warm) > _LEAST_RISE,
        "repeats": design.moving or design.samples >= LEAST_REPEATS,
    }
    return possible(need for need, is_met in met.items() if is_met)


def _shows(design: ExperimentDesign, effect: str) -> bool:
    """Whether one of a few large draws of an effect changes a design's readings enough to count."""
    robot = ImperfectRobot(design)
    for probe in range(_PROBES):
        item = DRAWS[effect](design, np.random.default_rng([probe, 7]), 0.8 * LARGEST)
        with np.errstate(invalid="ignore"):
            difference = robot.reading([(item, 1.0)]) - design.nominal
        if np.isfinite(difference).all() and design.usual.gap(difference) > _PROBED_GAP:
            return True
    return False


def background(robot: ImperfectRobot, rng: Rng) -> list[Scaled]:
    """Draw a robot's minor imperfections: most effects at once with a small random total gap, and
    stated numbers that are wrong within tolerance."""
    design = robot.design
    target = log_uniform(rng, SMALLEST_BACKGROUND, 0.9 * LARGEST_BACKGROUND)
    around = _within_tolerance(design, rng)
    drawn = []
    for effect in _fitting(design):
        if between(effect) or effect in _NOT_IN_BACKGROUND or rng.uniform() > _PRESENT:
            continue
        size = 0.1 * float(np.exp(0.7 * rng.standard_normal()))
        seed = int(rng.integers(2**62))
        drawn.append(DRAWS[effect](design, np.random.default_rng(seed), size))
    scale = 0.5
    for _ in range(_SCALINGS):
        reading = robot.reading([(item, scale) for item in drawn])
        reached = design.usual.gap(reading - design.nominal)
        if SMALLEST_BACKGROUND <= reached <= min(1.3 * target, LARGEST_BACKGROUND):
            break
        scale *= float(np.clip(np.sqrt(0.95 * target / max(reached, 1e-12)), 1e-3, 1e3))
    return [*around, *[(item, scale) for item in drawn], (_between_rows(design, rng), 1.0)]


def _within_tolerance(design: ExperimentDesign, rng: Rng) -> list[Scaled]:
    """Errors of bias, mass and CoG within their tolerance, and an unstated sensor weight."""
    mass, cog, bias = design.tolerance
    shift = rng.uniform(-0.9, 0.9, 6) * bias
    more = float(rng.uniform(-0.9, 0.9) * mass)
    direction = rng.standard_normal(3)
    error = rng.uniform(0.0, 0.9) * cog * direction / np.linalg.norm(direction)
    weight = 0.04 * min(0.1, 0.4 * mass / 0.04) * imperfection.spread(rng)
    weighing = Imperfection(
        {"mass": weight}, tool=lambda load, _: replace(load, sensor_mass=load.sensor_mass + weight)
    )
    faults = {
        "tool.mass": imperfection.heavier(more),
        "tool.cog": imperfection.off(error),
        "sensor.bias": imperfection.biased(shift),
        "tool.self_weight": weighing,
    }
    return [(replace(fault, name=name), 1.0) for name, fault in faults.items()]


def _between_rows(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw quantization and vibration far below the noise."""
    step = rng.uniform(0.0, 0.4) * design.noise_std
    drawn = faults.base_vibration(design, rng, rng.uniform(0.02, 0.2)).rows
    assert drawn is not None and drawn.shake is not None
    wrench, frequency = drawn.shake
    rise = float(np.max(np.mean((wrench / design.noise_std) ** 2, axis=0)))
    wrench = min(1.0, float(np.sqrt(MOST_RISE / max(rise, 1e-12)))) * wrench
    rows = imperfection.RowImperfection(step=step, shake=imperfection.Shaking(wrench, frequency))
    return Imperfection(name="background", rows=rows)


def families(design: ExperimentDesign) -> tuple[str, ...]:
    """Names of the faults that no effect of the library describes and that a design can show."""
    return tuple(n for n in FAMILIES if design.robot.joints or n not in _BY_JOINTS)


@dataclass(frozen=True, eq=False)
class LookalikeCase:
    """A simulated robot with known faults, its readings, and how much each fault changes them.

    ``clean`` is the noise-free reading of each hold or sample (N, 6) with all causes; ``gaps`` and
    ``rows`` are `Shown.gap` and `Shown.rows` (where not 0) of each cause by its name,
    ``background`` is the gap of minor imperfections, ``items`` all imperfections with amounts.
    """

    seed: int
    kind: str
    clean: np.ndarray
    gaps: Mapping[str, float] = field(default_factory=dict)
    rows: Mapping[str, float] = field(default_factory=dict)
    background: float = 0.0
    items: tuple[Scaled, ...] = ()

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of the causes that are effects of the library; empty for a fault outside it."""
        return () if self.kind == "outside" else tuple(self.gaps)

    @property
    def outside(self) -> str | None:
        """Name of the cause if it is a fault that no effect of the library describes, else None."""
        return next(iter(self.gaps)) if self.kind == "outside" else None

    def true_parameters(self, effect: str) -> dict[str, float]:
        """True parameters of a cause by name, SI, with minor imperfections of its name added."""
        cause = next(item for item, _ in reversed(self.items) if item.name == effect)
        return {k: float(v) for k, v in common.true_numbers(cause, self.items).items()}


def draw(
    design: ExperimentDesign,
    seed: int,
    kind: str = "single",
    effect: str | None = None,
    size: float | None = None,
) -> LookalikeCase:
    """Draw a case, which depends on design and seed alone; a `ParameterError` for an unknown kind
    or effect, or one that this design cannot show.

    ``effect`` is the name of the (first) cause or of the outside family, ``size`` that of the cause
    in multiples of the typical one: random if None, the size then grown until it shows.
    """
    if kind not in common.KINDS:
        raise ParameterError(f"there is no kind of case {kind!r}. Known: {', '.join(common.KINDS)}")
    drawing = _Drawing(design, seed, kind, size)
    if kind == "none":
        return drawing.case([])
    if kind == "outside":
        return drawing.outside(effect)
    known = effects(design)
    if effect is not None and effect not in known:
        raise ParameterError(f"this design shows no {effect!r}. It shows: {', '.join(known)}")
    if kind == "single":
        return drawing.case([drawing.any_of(known, effect)])
    return drawing.pair(known, effect)


@dataclass(frozen=True, eq=False)
class _Measured(common.Shown):
    """A cause, the gap and rise of variance that it adds, and the clean reading with it (N, 6)."""

    item: Imperfection
    reading: np.ndarray


class _Drawing:
    """Draws the causes of one case, beside minor imperfections that were drawn before."""

    def __init__(self, design: ExperimentDesign, seed: int, kind: str, size: float | None) -> None:
        self.design, self.seed, self.kind, self.size = design, seed, kind, size
        self.rng = np.random.default_rng([seed, 1])
        self.robot = ImperfectRobot(design)
        self.around = background(self.robot, self.rng)
        self.base = self.robot.reading(self.around)
        self.minor = design.usual.gap(self.base - design.nominal)

    def any_of(self, known: Sequence[str], effect: str | None) -> _Measured:
        """Draw one cause that is large enough: the given effect, or a random one of ``known``."""
        remaining = list(known)
        for _ in range(_EFFECT_TRIES):
            name = effect if effect is not None else str(self.rng.choice(remaining))
            cause = self._grown(name)
            if cause is not None:
                return cause
            if effect is None and len(remaining) > 1:
                remaining.remove(name)
        raise ParameterError(f"{effect or 'no effect'} shows enough in this design")

    def pair(self, known: Sequence[str], effect: str | None) -> LookalikeCase:
        """Draw a case of two large enough causes of ``known`` (one is ``effect``, if given)."""
        around, base = self.around, self.base
        for _ in range(_EFFECT_TRIES):
            first = self.any_of(known, effect)
            self._surround([*around, (first.item, 1.0)])
            others = common.of_another_subsystem(known, first.item.name)
            second = self.any_of(others, None)
            self._surround([*around, (second.item, 1.0)])
            again = self._measure(first.item)
            self.around, self.base = around, base
            if self.size is not None or again.amount >= again.needed(self.kind):
                return self.case([again, second])
        raise ParameterError("no two causes show together in this design")

    def outside(self, family: str | None) -> LookalikeCase:
        """Draw a case of a fault that no effect describes (``family``, or any), of random gap."""
        known = families(self.design)
        if family is not None and family not in known:
            raise ParameterError(f"there is no family {family!r}. Known: {', '.join(known)}")
        for _ in range(_EFFECT_TRIES):
            name = family if family is not None else str(self.rng.choice(known))
            item = FAMILIES[name](self.design, self.rng)
            target = log_uniform(self.rng, 2.5, 40.0)
            amount = 1.0
            for _ in range(5):
                reading = self.robot.reading([*self.around, (item, amount)])
                reached = self.design.usual.gap(reading - self.base)
                if common.NEEDED["outside"] <= reached <= 2.0 * target:
                    return self.case([_Measured(reached, 0.0, item, reading)], amount)
                amount *= float(np.clip(np.sqrt(target / max(reached, 1e-12)), 1e-3, 30.0))
        raise ParameterError(f"{family or 'no family'} shows enough in this design")

    def case(self, causes: Sequence[_Measured], amount: float = 1.0) -> LookalikeCase:
        """Make the case of causes; the first's reading has all of them, in this ``amount``."""
        return LookalikeCase(
            self.seed,
            self.kind,
            causes[0].reading if causes else self.base,
            {c.item.name: c.gap for c in causes},
            {c.item.name: c.rows for c in causes if c.rows},
            self.minor,
            (*self.around, *[(c.item, amount) for c in reversed(causes)]),
        )

    def _surround(self, around: list[Scaled]) -> None:
        self.around, self.base = around, self.robot.reading(around)

    def _grown(self, name: str) -> _Measured | None:
        """Draw an effect and enlarge it until it counts as a cause; None after `_TRIES`."""
        now = self.size if self.size is not None else log_uniform(self.rng, *common.SIZES)
        for _ in range(_TRIES):
            cause = self._measure(DRAWS[name](self.design, self.rng, now))
            needed = cause.needed(self.kind)
            if (self.size is not None and np.isfinite(cause.gap)) or cause.amount >= needed:
                return cause
            if not np.isfinite(cause.amount):
                now = 0.5 * now
                continue
            growth = float(np.sqrt(_MARGIN * needed / max(cause.amount, 1e-12)))
            if cause.amount < 0.01 * needed:  # the draw, not the size, is what does not show
                growth = 1.2
            now = min(now * float(np.clip(growth, 1.05, 3.0)), LARGEST)
        return None

    def _measure(self, item: Imperfection) -> _Measured:
        """Measure what an imperfection adds beside all others; its gap is NaN if no pose exists."""
        if between(item.name) and item.rows is not None:
            noise, held = self.design.noise_std, imperfection.held_rows
            rise = item.rows.rise(noise, self.base, lambda shake: shake.wrench, held)
            return _Measured(float(rise.mean()), float(rise.max()), item, self.base)
        with np.errstate(invalid="ignore"):
            reading = self.robot.reading([*self.around, (item, 1.0)])
        if not np.isfinite(reading).all():
            return _Measured(float("nan"), 0.0, item, self.base)
        gap = self.design.usual.gap(reading - self.base, item.name in STATED)
        return _Measured(gap, 0.0, item, reading)


def recording(design: ExperimentDesign, case: LookalikeCase) -> Recording:
    """Make the recording of a case, with noise, clock jitter and effects on the scatter of rows."""
    rng = np.random.default_rng([case.seed, 3])
    rows = _rows(design, case)
    count, samples = rows.shape[:2]
    offset = (np.arange(samples) - (samples - 1) / 2.0) / design.rate
    if design.moving:
        t = design.t
    else:
        jitter = np.clip(rng.normal(0.0, 0.04, (count, samples)), -0.3, 0.3) / design.rate
        t = (design.t[:, None] + offset + jitter).ravel()
        least = 1e-3 / design.rate * np.arange(len(t))  # holds of uneven length may touch
        t = np.maximum.accumulate(t - least) + least
        t = t - min(0.0, float(t[0]))
    q = np.repeat(design.q, samples, axis=0)
    q = q + rng.normal(0.0, _ENCODER * (0.01 if design.moving else 1.0), q.shape)
    placed = common.numbered("q", q)
    if not design.robot.joints:
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        placed = dict(zip(QUATERNION, q.T, strict=True))
    segment = np.zeros(count) if design.moving else np.arange(count)
    columns = {"t": t, "segment": np.repeat(segment.astype(np.int64), samples)}
    columns |= placed | dict(zip(CHANNELS, rows.reshape(-1, 6).T, strict=True))
    if design.temperature is not None:
        warm = np.repeat(design.temperature, samples)
        columns["temperature"] = np.round(warm + rng.normal(0.0, 0.02, len(warm)), 2)
    return Recording(design.metadata, columns, f"lookalike-{case.seed}")


def _rows(design: ExperimentDesign, case: LookalikeCase) -> np.ndarray:
    """Readings (N, samples, 6) [N, N·m] of all rows of a case, with noise."""
    rng = np.random.default_rng([case.seed, 2])
    samples = 1 if design.moving else design.samples
    slow, scatter = row_noise(design, rng, samples)
    changed = [i.rows for i, _ in case.items if i.rows is not None]
    load = case.clean
    if any(np.isfinite(r.limit).any() for r in changed):  # noise comes before the range
        load = ImperfectRobot(design).reading(case.items, clip=False)
    if design.moving:  # the clock of the sensor jitters
        late = np.clip(rng.normal(0.0, 1.5e-4, len(load)), -5e-4, 5e-4)
        load = load + late[:, None] * np.gradient(load, design.t, axis=0)
    for r in changed:
        scatter = scatter * r.gain
    y = (load + slow)[:, None, :] + scatter
    when = design.t[:, None] + np.arange(samples) / design.rate
    for r in changed:
        if r.shake is not None:
            wave = _shaking(when, r.shake.frequency, rng)
            y = y + r.shake.wrench[:, None, :] * wave[..., None]
    y = common.converted(y, changed)
    for r in changed:
        if r.stale[0] > 0.0:
            flat = y.reshape(-1, 6)
            y = flat[imperfection.held_rows(len(flat), r.stale, rng)].reshape(y.shape)
    return y


def row_noise(design: ExperimentDesign, rng: Rng, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a 1/f wander over the run (N, 6), and noise of rows (N, samples, 6), by a random law.

    A share of rows is Student-t with 4 to 8 degrees of freedom, a share of the variance AR(1);
    channels are correlated, each with a level of its own. In motion all rows are one run.
    """
    mixing = np.eye(6) + 0.25 * rng.standard_normal((6, 6))
    mixing = mixing / np.linalg.norm(mixing, axis=1, keepdims=True)
    level, tails = rng.uniform(0.95, 1.05, 6), rng.uniform(0.0, 0.7)
    freedom, memory = rng.uniform(4.0, 8.0), rng.uniform(0.0, 0.6)
    keep, wander = rng.uniform(0.0, 0.6), rng.uniform(0.0, WANDER) * rng.uniform(0.6, 1.0, 6)
    count = len(design)
    slow = imperfection.slow_noise(rng, count, 6) * wander * design.noise_std
    shape = (1, count, 6) if design.moving else (count, samples, 6)
    white = rng.standard_normal(shape)
    heavy = rng.uniform(size=shape[:2]) < tails
    spread = np.sqrt((freedom - 2.0) / rng.chisquare(freedom, shape[:2]))
    white *= np.where(heavy, spread, 1.0)[..., None]
    kicks = rng.standard_normal(shape) * np.sqrt(1.0 - keep**2)
    initial = keep * rng.standard_normal((shape[0], 1, 6))
    lagging = lfilter([1.0], [1.0, -keep], kicks, axis=1, zi=initial)[0]
    unit = np.sqrt(1.0 - memory) * white + np.sqrt(memory) * lagging
    return slow, (unit @ mixing.T * (level * design.noise_std)).reshape(count, -1, 6)


def _shaking(t: np.ndarray, frequency: float, rng: Rng) -> np.ndarray:
    """Unit signal at times (N, n) [s]: a tone of varying amplitude, broadband at frequency 0."""
    if frequency <= 0.0:
        return rng.standard_normal(t.shape)
    breath = 0.3 * np.sin(0.11 * frequency * t + rng.uniform(0.0, 6.28))
    wave = np.sin(2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.28))
    return np.asarray(np.sqrt(2.0) * (1.0 + breath) * wave / np.sqrt(1.0 + 0.045))
