"""Semi-real cases: a fault of the referee's physics added to a real recording.

Noise, imperfections and design are the recording's own. A fault's signature is computed on what a
rigid tool makes along the recording's time axis, and its difference is added to the recorded rows.
Constants are estimates.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from wrenchbed.benchmark.referee import case as referee
from wrenchbed.benchmark.referee import outside, sensor
from wrenchbed.benchmark.referee.case import KINDS, NEEDED, ROWS_NEEDED, SIZES
from wrenchbed.benchmark.referee.catalogue import EFFECTS, STATED
from wrenchbed.benchmark.referee.equivalence import Bench, Usual, bench
from wrenchbed.benchmark.referee.fault import RefereeFault, Rng, named, touched
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.benchmark.referee.signatures import blocks_of_orientations
from wrenchbed.benchmark.sealed import commitments, make
from wrenchbed.benchmark.sealed.answer import Answer, Fact
from wrenchbed.benchmark.sealed.real import plain
from wrenchbed.benchmark.sealed.real_setting import ACCELEROMETER, RealSetting, setting_of
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS

_TRIES = 60
"""Causes that are drawn before giving up."""
_BY_JOINTS = ("joint.", "link.", "cable.", "environment.", "base.compliance", "tool.inertia",
              "tool.loose", "tool.flexure", "tool.self_weight")  # fmt: skip
"""Beginnings of names of effects that a rigid tool in known orientations cannot show."""
_OUTSIDE = ("popcorn", "triple", "gusts", "dropout")
"""The referee's families that need no joints and that an accelerometer does not show."""
_ZEROED = 0.02
"""A bias counts as stated where its tolerance is below this share of full scale."""


def bursts(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A welder nearby: in short spells the readings are torn apart."""
    t = setting.path.t
    on = np.zeros(len(t))
    for start in rng.uniform(t[0], t[-1], int(rng.integers(3, 9))):
        on[(t >= start) & (t < start + rng.uniform(0.02, 0.08) * (t[-1] - t[0]))] = 1.0
    level = 8.0 * size * setting.noise * touched(rng)
    kicks = rng.standard_normal((len(t), 6))
    return RefereeFault(gauge=lambda ride, y: y + on[:, None] * kicks * level, stage=sensor.ZERO)


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


FAMILIES = {
    **{name: outside.FAMILIES[name] for name in _OUTSIDE},
    "bursts": named("bursts", bursts),
    "knock": named("knock", knock),
}
"""Faults outside the library, by name."""


@dataclass(frozen=True, eq=False)
class AddedCause:
    """A fault with what it adds to a recording.

    Attributes:
        fault: the fault.
        signature: change of the means that are compared (n, 6) [N, N·m].
        gap: that it adds; of a cause between rows the mean rise of a row's variance.
        rows: largest rise of a channel's row variance, 0 for a cause that shows in means.
    """

    fault: RefereeFault
    signature: np.ndarray
    gap: float
    rows: float


@dataclass(frozen=True, eq=False)
class HostRecording:
    """A recording that faults are added to.

    Attributes:
        setting: the recording with a rigid tool fitted to it.
        noise_seed: of noise that faults add.
    """

    setting: RealSetting
    noise_seed: tuple[int, ...] = ()

    @cached_property
    def usual(self) -> Usual:
        """What every fit removes."""
        white = self.setting.nuisance() / self.setting.own[:, None]
        white = white.reshape(-1, white.shape[-1])
        return Usual(self.setting.own, np.linalg.qr(white / np.linalg.norm(white, axis=0))[0])

    @cached_property
    def signatures(self) -> Bench:
        """Of the library, as far as orientations show them."""
        ride = self.setting.ride()
        return bench(self.setting, ride, self.usual, blocks_of_orientations)

    @property
    def real_gap(self) -> float:
        """Calibrated gap of the recording as it is."""
        s = self.setting
        residual = s.means(s.recording.wrench) - s.nominal
        floor = 1.0 if s.mode == "dynamic" else float(np.mean(1.0 / np.bincount(s.path.hold)))
        return self.usual.gap(residual, configured=False) - floor

    def with_faults(self, faults: Sequence[RefereeFault]) -> np.ndarray:
        """Recorded rows with some faults (N, 6) [N, N·m]."""
        rng = np.random.default_rng([*self.noise_seed, 7])
        return self.setting.with_faults(self.setting.recording.wrench, faults, rng)

    def cause(self, fault: RefereeFault, beside: Sequence[RefereeFault] = ()) -> AddedCause:
        """What a fault adds beside others."""
        change = self.with_faults([*beside, fault]) - self.with_faults(beside)
        if fault.name in EFFECTS and EFFECTS[fault.name].between:
            rise = np.mean((change / self.setting.scatter) ** 2, axis=0)
            return AddedCause(fault, np.zeros((1, 6)), float(rise.mean()), float(rise.max()))
        signature = self.setting.means(change)
        return AddedCause(fault, signature, self.usual.gap(signature, fault.name in STATED), 0.0)

    def possible(self) -> list[str]:
        """Effects that this recording can show."""
        s = self.setting
        moving, repeats = s.mode == "dynamic", bool(np.isfinite(s.scatter).all())
        zeroed = bool((1.5 * s.tolerance[2] < _ZEROED * s.full_scale).all())
        return [
            name
            for name, e in EFFECTS.items()
            if not name.startswith(_BY_JOINTS)
            and (moving or not e.motion)
            and (s.temperature is not None or not e.warm)
            and (repeats or not e.between)
            and (zeroed or name != "sensor.bias")
        ]

    def drawn(self, name: str, rng: Rng, size: float) -> RefereeFault:
        """A fault; sizes between rows follow the scatter of rows, a range the reading itself."""
        setting = self.setting
        if EFFECTS[name].between:
            setting = replace(setting, own=setting.scatter)
        elif name == "sensor.saturation":
            setting = replace(setting, offset=setting.bias)
        return EFFECTS[name].draw(setting, rng, size)

    def one(
        self, kind: str, names: Sequence[str], rng: Rng, beside: Sequence[RefereeFault] = ()
    ) -> AddedCause:
        """A cause that shows; where it is too small, once more and larger, then another one.

        Raises:
            ParameterError: nothing that was drawn shows enough.
        """
        for _ in range(_TRIES):
            name = str(rng.choice(names))
            between = EFFECTS[name].between
            needed = (ROWS_NEEDED if between else NEEDED)[kind]
            size = float(np.exp(rng.uniform(*np.log(SIZES))))
            for _ in range(2):
                cause = self.cause(self.drawn(name, rng, size), beside)
                shown = cause.rows if between else cause.gap
                if shown >= needed:
                    return cause
                least = size * float(np.sqrt(1.2 * needed / max(shown, 1e-9)))
                if least > SIZES[1]:
                    break
                size = float(np.exp(rng.uniform(np.log(least), np.log(SIZES[1]))))
        raise ParameterError("nothing that was drawn shows enough")

    def two(self, rng: Rng) -> list[AddedCause]:
        """Two causes of different subsystems that both show.

        Raises:
            ParameterError: none were found.
        """
        names = self.possible()
        first = self.one("pair", names, rng).fault
        others = [n for n in names if n.split(".")[0] != first.name.split(".")[0]]
        second = self.one("pair", others, rng, [first])
        again = self.cause(first, [second.fault])
        needed = ROWS_NEEDED if again.rows else NEEDED
        if (again.rows or again.gap) < needed["pair"]:
            raise ParameterError("no second cause leaves the first one visible")
        return [again, second]

    def outside(self, rng: Rng) -> AddedCause:
        """A fault that shows, and that no effect of the library could make.

        Raises:
            ParameterError: none was found.
        """
        for _ in range(_TRIES):
            family = FAMILIES[str(rng.choice(list(FAMILIES)))]
            size = float(np.exp(rng.uniform(np.log(0.5), np.log(2.0))))
            cause = self.cause(family(self.setting, rng, size))
            if cause.gap < NEEDED["outside"]:
                continue
            left = self.signatures.imitated(cause.signature, configured=False, bounded=False)
            if min(left.values()) >= referee.LIBRARY_LEAVES:
                return cause
        raise ParameterError("no fault outside the library shows")

    def recording(self, faults: Sequence[RefereeFault]) -> Recording:
        """The recording with some faults; what shakes or turns the tool shows in accelerations."""
        s = self.setting
        columns = dict(s.recording.columns)
        columns |= dict(zip(CHANNELS, self.with_faults(faults).T, strict=True))
        if s.accelerated:
            columns |= dict(zip(ACCELEROMETER, s.accelerations(faults).T, strict=True))
        return Recording(s.metadata, columns, "case")

    def fact(self, kind: str, cause: AddedCause) -> Fact:
        """A cause as an answer states it."""
        fault, alike = cause.fault, list[str]()
        if kind != "outside" and not cause.rows:
            alike = self.signatures.alike(fault.name, cause.signature)
        true = {k: float(v) for k, v in fault.true.items()}
        return Fact(fault.name, fault.size, cause.gap, cause.rows, true, tuple(alike))


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
        """The recording with a rigid tool fitted to it."""
        return setting_of(plain(Recording.read(self.source)))

    def check(self) -> None:
        """Refuse a recording that no tool can be fitted to.

        Raises:
            CalibrationError: its orientations cannot separate mass from bias.
            ParameterError: it states no noise and has no repeats.
        """
        assert self.setting is not None

    def about(self) -> dict[str, object]:
        """Without the file's place."""
        return {k: v for k, v in asdict(self).items() if k != "source"}

    def kinds(self) -> list[str]:
        """Kind of each case: one is the recording as it is, since more would be copies of it."""
        shares = np.array(referee.SHARES[1:]) / sum(referee.SHARES[1:])
        counts = np.concatenate([[1], np.floor(shares * (self.cases - 1) + 1e-9)]).astype(int)
        counts[KINDS.index("single")] += self.cases - int(counts.sum())
        order = np.random.default_rng([self.seed, 1]).permutation(np.repeat(range(4), counts))
        return [KINDS[k] for k in order]

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        """One case.

        Raises:
            ParameterError: this attempt finds none.
        """
        kind, name = self.kinds()[index], self.names()[index]
        rng = np.random.default_rng([self.seed, index, attempt, KINDS.index(kind)])
        host = HostRecording(self.setting, (self.seed, index, attempt))
        causes: list[AddedCause] = []
        if kind == "single":
            causes = [host.one(kind, host.possible(), rng)]
        elif kind == "pair":
            causes = host.two(rng)
        elif kind == "outside":
            causes = [host.outside(rng)]
        answer = Answer(
            name, self.robot, self.mode, kind, tuple(host.fact(kind, c) for c in causes), None,
            host.setting.points, None, commitments.salt(self.seed, name), real_gap=host.real_gap,
        )  # fmt: skip
        return answer, host.recording([c.fault for c in causes])
