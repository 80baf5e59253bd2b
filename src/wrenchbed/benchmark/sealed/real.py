"""Real cases: recordings of a robot on which somebody made the truth, sealed; and semi-real ones.

Semi-real: a fault of the referee's physics added to a real recording. Noise, imperfections and
design are the recording's own. A fault's signature is computed on what a rigid tool makes along the
recording's time axis, and its difference is added to the recorded rows. Constants are estimates.
"""

import re
import secrets
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from wrenchbed.benchmark import frame
from wrenchbed.benchmark.frame import EFFECTS, KINDS, Rng, between, register
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
from wrenchbed.errors import BenchmarkError
from wrenchbed.files import write_bytes
from wrenchbed.files.checked import Fields, is_number, load
from wrenchbed.physics.wrench import CHANNELS

CAUSES = {"none": 0, "single": 1, "pair": 2, "outside": 1}
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


def seal_real(truth: Path, out: Path, answers: Path) -> str:
    """Seal real recordings in random order under numbers; SHA-256 of ``commitments.json``.

    Args:
        truth: TOML file, see docs/how-to/sealed.md; recordings are looked for beside it.
        out: empty folder for cases.
        answers: empty folder for answers.

    Raises:
        BenchmarkError: names the file, case and field that is wrong.
        RecordingError: a recording cannot be trusted.
    """
    cases = list(_cases(truth))
    commitments.check_separate(out, answers)
    for folder in (out, answers):
        folder.mkdir(parents=True, exist_ok=True)
        other = next(folder.iterdir(), None)
        if other is not None:
            raise BenchmarkError(f"{other}: give empty folders")
    seed = make.drawn_seed()
    names = {}
    for place, k in enumerate(np.random.default_rng(seed).permutation(len(cases)), start=1):
        kind, causes, recording = cases[k]
        name, meta = f"{place:04d}", recording.metadata
        names[name] = meta
        salt = commitments.salt(seed, name)
        rows = len(recording)
        answer = Answer(name, meta.robot, meta.mode, kind, causes, None, rows, None, salt)
        commitments.write_recording(recording, commitments.recording_of(out, name))
        write_bytes(commitments.answer_of(answers, name), answer.to_bytes())
    robots = "|".join(sorted({m.robot for m in names.values()}))
    modes = "|".join(sorted({m.mode for m in names.values()}))
    about = {"source": truth.name, "cases": len(cases), "salt": secrets.token_hex(16)}
    return commitments.commit(out, answers, robots, modes, names, about)


def _cases(truth: Path) -> Iterator[tuple[str, tuple[Fact, ...], Recording]]:
    raw = load(truth, BenchmarkError, "TOML")
    listed = raw.get("case")
    if not isinstance(listed, list) or not listed:
        raise BenchmarkError(f"{truth}: has no [[case]]")
    for number, entry in enumerate(listed, start=1):
        where = f"{truth}: case {number}: "
        case = Fields(entry, where, BenchmarkError)
        kind = case.choice("kind", KINDS, f"is none of {', '.join(KINDS)}")
        if not isinstance(case.raw.get("cause", []), list):
            raise BenchmarkError(f"{where}write causes as [[case.cause]], in double brackets")
        causes = tuple(_fact(cause, kind) for cause in case.parts("cause"))
        if len(causes) != CAUSES[kind]:
            raise BenchmarkError(
                f"{where}kind {kind!r} has {CAUSES[kind]} [[case.cause]], found {len(causes)}"
            )
        name = case.stated_text("recording", "is no file name")
        yield kind, causes, plain(Recording.read(truth.parent / name))


def _fact(cause: Fields, kind: str) -> Fact:
    effect = cause.stated_text("effect", "must be a name")
    if kind != "outside" and effect not in EFFECTS:
        raise cause.error("effect", f"is unknown; known are {', '.join(EFFECTS)}")
    tables = cause.part("true").raw  # cog.x = 1 is a table in a table
    inner = {k: v if isinstance(v, Mapping) else {"": v} for k, v in tables.items()}
    true = {f"{k}.{n}" if n else k: v for k, t in inner.items() for n, v in t.items()}
    if not all(map(is_number, true.values())):
        raise cause.error("true", "must be a table of numbers, SI")
    rows = 1.0 if kind != "outside" and EFFECTS[effect].between else 0.0
    return Fact(effect, None, None, rows, {k: float(v) for k, v in true.items()}, ())


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
