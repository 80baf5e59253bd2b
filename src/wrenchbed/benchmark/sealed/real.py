"""Semi-real cases: a fault of the referee's physics added to a real recording.

Noise, imperfections and design are the recording's own. A fault's signature is computed on what a
rigid tool makes along the recording's time axis, and its difference is added to the recorded rows.
Constants are estimates.
"""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from wrenchbed.benchmark import frame
from wrenchbed.benchmark.frame import KINDS, Rng, between, register
from wrenchbed.benchmark.referee import case as referee
from wrenchbed.benchmark.referee import sensor
from wrenchbed.benchmark.referee.case import TrueCause, World
from wrenchbed.benchmark.referee.catalogue import FAMILIES as OF_REFEREE
from wrenchbed.benchmark.referee.fault import DRAWS, Draw, RefereeFault, touched
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.benchmark.referee.signatures import Bench, bench, blocks_of_orientations
from wrenchbed.benchmark.sealed import commitments, make
from wrenchbed.benchmark.sealed.commitments import Answer, Fact
from wrenchbed.benchmark.sealed.real_setting import ACCELEROMETER, RealSetting, setting_of
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

_KEPT = re.compile(
    r"t|segment|status|temperature|f[xyz]|t[xyz]|a[xyz]|q[wxyz]|q\d+|qd\d+|q_target\d+|tau\d+"
)
"""Columns of the contract; others may tell more than they should."""
_UNSAID = ("source",)
"""Fields of the metadata that tell where a recording is from."""
_BY_MACHINE = ("tool.inertia", "tool.loose", "tool.flexure")
"""Effects that a rigid tool in known orientations cannot show, besides those of joints."""
FAMILIES: dict[str, Draw] = {n: OF_REFEREE[n] for n in ("popcorn", "triple", "gusts", "dropout")}
"""Faults outside the library by name: the referee's that need no joints and that an accelerometer
does not show, and two of their own."""
_ZEROED = 0.02
"""A bias counts as stated where its tolerance is below this share of full scale."""


def plain(recording: Recording) -> Recording:
    """A recording with what the contract names, and nothing else that might tell."""
    meta = {k: v for k, v in recording.metadata.to_json().items() if k not in _UNSAID}
    columns = {k: v for k, v in recording.columns.items() if _KEPT.fullmatch(k)}
    known = {k: meta[k] for k in meta if k not in recording.metadata.extra}
    return Recording(parse(known, recording.name), columns, recording.name)


@register(FAMILIES, "bursts")
def bursts(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A welder nearby: in short spells the readings are torn apart."""
    t = setting.path.t
    on = np.zeros(len(t))
    for start in rng.uniform(t[0], t[-1], int(rng.integers(3, 9))):
        on[(t >= start) & (t < start + rng.uniform(0.02, 0.08) * (t[-1] - t[0]))] = 1.0
    level = 8.0 * size * setting.noise * touched(rng)
    kicks = rng.standard_normal((len(t), 6))
    return RefereeFault(gauge=lambda ride, y: y + on[:, None] * kicks * level, stage=sensor.ZERO)


@register(FAMILIES, "knock")
def knock(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Somebody knocks at the tool, and its fixture creaks back: zeros spring and return slowly."""
    t = setting.path.t
    blows = rng.uniform(t[0], t[-1], int(rng.integers(2, 6)))
    back = rng.uniform(0.03, 0.15) * (t[-1] - t[0])
    since = t[:, None] - blows
    course = np.where(since >= 0.0, np.exp(-np.maximum(since, 0.0) / back), 0.0)
    push = 8.0 * size * setting.noise * touched(rng)
    sides = rng.choice([-1.0, 1.0], len(blows))
    return RefereeFault(gauge=lambda ride, y: y + np.outer(course @ sides, push), stage=sensor.ZERO)


@dataclass(frozen=True, eq=False)
class HostRecording(World):
    """A recording that faults are added to.

    Attributes:
        setting: the recording with a rigid tool fitted to it.
        noise_seed: of noise that faults add.
    """

    setting: RealSetting
    around: tuple[RefereeFault, ...] = ()
    noise_seed: tuple[int, ...] = ()

    draws = draws_outside = 60
    pairs = 1
    families = FAMILIES

    @cached_property
    def signatures(self) -> Bench:
        """Signatures of the library's effects as far as orientations show them."""
        return bench(self.setting, self.setting.ride(), self.usual, blocks_of_orientations)

    @property
    def real_gap(self) -> float:
        """Calibrated gap of the recording without added faults."""
        s = self.setting
        residual = s.means(s.recording.wrench) - s.nominal
        floor = 1.0 if s.mode == "dynamic" else float(np.mean(1.0 / np.bincount(s.path.hold)))
        return self.usual.gap(residual, configured=False) - floor

    def with_faults(self, faults: Sequence[RefereeFault]) -> np.ndarray:
        """Recorded rows with some faults (N, 6) [N, N·m]."""
        rng = np.random.default_rng([*self.noise_seed, 7])
        return self.setting.with_faults(self.setting.recording.wrench, faults, rng)

    def measured(self, fault: RefereeFault) -> TrueCause:
        """Readings and gap that a fault adds beside the present faults."""
        world = replace(self, around=(*self.around, fault))
        change = self.with_faults(world.around) - self.with_faults(self.around)
        if between(fault.name):
            rise = np.mean((change / self.setting.scatter) ** 2, axis=0)
            return self.cause(fault, world, np.zeros((1, 6)), rise)
        return self.cause(fault, world, self.setting.means(change), None)

    def again(self, first: TrueCause, second: TrueCause) -> TrueCause:
        """Readings and gap that the first of two causes adds beside the second."""
        return replace(self, around=(*self.around, second.fault)).measured(first.fault)

    def possible(self) -> list[str]:
        """Names of the effects that this recording can show."""
        s = self.setting
        shown = ["motion"] if s.mode == "dynamic" else []
        shown += ["repeats"] if np.isfinite(s.scatter).all() else []
        shown += ["warmth"] if s.temperature is not None else []
        zeroed = bool((1.5 * s.tolerance[2] < _ZEROED * s.full_scale).all())
        hidden = _BY_MACHINE if zeroed else (*_BY_MACHINE, "sensor.bias")
        return [name for name in frame.possible(shown) if name not in hidden]

    def drawn(self, name: str, rng: Rng, size: float) -> RefereeFault:
        """A fault; sizes between rows follow the scatter of rows, a range the reading itself."""
        setting = self.setting
        if between(name):
            setting = replace(setting, own=setting.scatter)
        elif name == "sensor.saturation":
            setting = replace(setting, offset=setting.bias)
        return replace(DRAWS[name](setting, rng, size), size=size)

    def recorded(self, faults: Sequence[RefereeFault]) -> Recording:
        """The recording with some faults; what shakes or turns the tool shows in accelerations."""
        s = self.setting
        columns = dict(s.recording.columns)
        columns |= dict(zip(CHANNELS, self.with_faults(faults).T, strict=True))
        if s.accelerated:
            columns |= dict(zip(ACCELEROMETER, s.accelerations(faults).T, strict=True))
        return Recording(s.metadata, columns, "case")


@dataclass(frozen=True)
class SemiRealFamily(make.Family):
    """Cases made of one real recording.

    Attributes:
        recording: SHA-256 of its file.
        source: that file.
    """

    recording: str
    source: Path

    @classmethod
    def on(cls, source: Path, cases: int, seed: int) -> "SemiRealFamily":
        """A family on a recording.

        Raises:
            RecordingError: the file is no recording.
        """
        meta = Recording.read(source).metadata
        digest = commitments.digest(source.read_bytes())
        return cls(meta.robot, meta.mode, cases, seed, digest, source)

    @cached_property
    def setting(self) -> RealSetting:
        """Setting: the recording with a rigid tool fitted to it."""
        return setting_of(plain(Recording.read(self.source)))

    def check(self) -> None:
        """Refuse a recording that no tool can be fitted to.

        Raises:
            CalibrationError: its orientations cannot separate mass from bias.
            ParameterError: it states no noise and has no repeats.
        """
        assert self.setting is not None

    def about(self) -> dict[str, object]:
        """Contents of ``family.json``, without the file's path."""
        return {k: v for k, v in asdict(self).items() if k != "source"}

    def kinds(self) -> list[str]:
        """Draw the kind of each case; one alone is the unchanged recording: more were copies."""
        shares = np.array(referee.SHARES[1:]) / sum(referee.SHARES[1:])
        counts = np.concatenate([[1], np.floor(shares * (self.cases - 1) + 1e-9)])
        return self.shuffled(counts.astype(int))

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        """Answer and recording of one case.

        Raises:
            ParameterError: this attempt finds none.
        """
        kind, name = self.kinds()[index], self.names()[index]
        rng = np.random.default_rng([self.seed, index, attempt, KINDS.index(kind)])
        host = HostRecording(self.setting, noise_seed=(self.seed, index, attempt))
        causes = host.causes(kind, rng)
        facts = tuple(Fact.of(host, c, kind, c.fault.true) for c in causes)
        answer = Answer(
            name, self.robot, self.mode, kind, facts, None, host.setting.points, None,
            commitments.salt(self.seed, name), real_gap=host.real_gap,
        )  # fmt: skip
        return answer, host.recorded([c.fault for c in causes])
