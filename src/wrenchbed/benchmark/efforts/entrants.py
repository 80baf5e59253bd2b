"""Arms of the efforts' benchmark, and what entrants say of its cases: rows of truth and claims."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.benchmark.efforts import case
from wrenchbed.benchmark.efforts.case import EffortTruth, Key
from wrenchbed.errors import ParameterError, WrenchbedError
from wrenchbed.files import write_text
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.described import describe
from wrenchbed.robots.serial_arm import mjcf_of
from wrenchbed.robots.ur5 import ur_arm

OURS = "wrenchbed"
"""Name of the diagnosis among the entrants."""
DEVELOPMENT, FINAL = 1000, 10000
"""Seeds below the first are for development, from the second on final; by definition."""
FAMILY = ("ur3e", "ur5e", "ur10e", "ur16e")
"""Arms of Universal Robots that are written as MJCF."""
FILES = {"iiwa.xml": "right_hand", "panda.xml": "right_hand", "ur10.urdf": "tool0",
         "xarm7.urdf": "link_eef"}  # fmt: skip
"""Files of arms by others, with the frame of the sensor."""
MOST = 5
"""Members of a class that still name something, as in the contract."""
JOINT = "joint"
"""Parameter's name for the 1-based joint or link."""
_TOOL_MASS, _TOOL_COG = 1.2, (0.0, 0.0, 0.05)
"""Mass [kg] and centre of gravity [m] of a first tool, an estimate that each case replaces."""
_ARMS: dict[Path, Sequence[SimulatedRobot]] = {}


def arms(files: Path, scratch: Path) -> list[SimulatedRobot]:
    """The UR5 and all other arms; those from files are known to the registry afterwards.

    Args:
        files: a folder with `FILES`.
        scratch: a folder where the family's MJCF files may lie.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    robots: list[SimulatedRobot] = [registry.load("robots", "ur5")]
    sources = {files / name: frame for name, frame in FILES.items()}
    for name in FAMILY:
        path = scratch / f"{name}.xml"
        write_text(path, mjcf_of(ur_arm(name).arm))
        sources[path] = "flange"
    for path, frame in sources.items():
        record = scratch / f"{path.stem}.toml"
        robot = describe(path, frame, record, tool_mass=_TOOL_MASS, tool_cog=_TOOL_COG).robot
        assert isinstance(robot, SimulatedRobot)
        registry.remember("robots", robot.name, robot.record or {})
        robots.append(robot)
    return robots


@dataclass(frozen=True)
class EffortClaim:
    """An answer.

    Attributes:
        verdict: of the contract.
        causes: class of effects with joints of each claimed cause, first choice first.
        presence: probability of each.
        unknown: probability of ``unknown``.
        none: probability of ``none``.
        seconds: that it took.
        error: what went wrong, empty if nothing did.
    """

    verdict: str
    causes: tuple[tuple[Key, ...], ...] = ()
    presence: tuple[float, ...] = ()
    unknown: float = 0.0
    none: float = 0.0
    seconds: float = 0.0
    error: str = ""


def of_json(raw: Mapping[str, Any], seconds: float) -> EffortClaim:
    """The claim of a `diagnosis.json`.

    Raises:
        KeyError, TypeError, ValueError: it is not of the contract's form.
    """
    which = list(raw["which"])
    odds = raw.get("probabilities", {})
    return EffortClaim(
        str(raw["verdict"]),
        tuple(_class(entry) for entry in which),
        tuple(float(entry["probability"]) for entry in which),
        float(odds.get("unknown", 0.0)),
        float(odds.get("none", 0.0)),
        seconds,
    )


def _class(entry: Mapping[str, Any]) -> tuple[Key, ...]:
    """Effects and joints that an entry of ``which`` claims as one class."""
    joint = entry.get("parameters", {}).get(JOINT)
    joints: list[int | None] = [None]
    if joint is not None:
        at = joint if isinstance(joint, int) else joint["value"]
        others = [] if isinstance(joint, int) else joint.get("rivals", [])
        joints = [int(at), *(int(j) for j in others)]
    effects = [str(e) for e in (entry["effect"], *entry.get("rivals", []))]
    if len(effects) > MOST:
        raise ValueError(f"the class of {effects[0]} has more than {MOST} members")
    return tuple(_key(e, j) for e in effects for j in joints)


def _key(effect: str, joint: int | None) -> Key:
    """Joint named in the effect's name or beside it; tool and base have none."""
    name, _, number = effect.rpartition(".")
    if number.isdigit():
        return (name, int(number))
    return (effect, joint if effect.startswith(("drive.", "link.")) else None)


def always_none(_: EffortTruth) -> EffortClaim:
    """Claim that nothing is wrong."""
    return EffortClaim("none", none=1.0)


def oracle(truth: EffortTruth) -> EffortClaim:
    """Claim of the truth itself."""
    if truth.kind == "none":
        return always_none(truth)
    if truth.kind == "outside":
        return EffortClaim("unknown", unknown=1.0)
    return EffortClaim("identified", (((truth.family, truth.joint),),), (1.0,))


TRIVIAL = {"always none": always_none, "oracle": oracle}
"""Entrants by rule, which show what the score is worth."""


@dataclass(frozen=True)
class EffortJob:
    """One case to make and to answer; ``keep`` is a folder for recordings and answers, or none."""

    seed: int
    number: int
    wrench: bool
    entrants: tuple[str, ...]
    files: Path
    scratch: Path
    keep: Path | None = None

    @property
    def id(self) -> str:
        """Identifier of the case, unique in a benchmark."""
        return f"{self.seed}-{self.number}{'-wrench' if self.wrench else ''}"


def check_seed(seed: int) -> str:
    """Purpose of a seed: ``development`` or ``final``.

    Raises:
        ParameterError: it lies between those for development and those for a final score.
    """
    if DEVELOPMENT <= seed < FINAL or seed < 0:
        raise ParameterError(
            f"--seed {seed}: seeds below {DEVELOPMENT} are for development, from {FINAL} on for a "
            "final score; others are left free"
        )
    return "development" if seed < DEVELOPMENT else "final"


def answer(job: EffortJob) -> dict[str, Any]:
    """The row of a case: its truth and every entrant's claim."""
    if job.files not in _ARMS:
        _ARMS[job.files] = arms(job.files, job.scratch)
    made = case.make(_ARMS[job.files], job.seed, job.number, wrench=job.wrench)
    claims = {name: asdict(_ask(name, made)) for name in job.entrants}
    if job.keep is not None:
        made.write(job.keep / f"{job.id}.parquet", job.keep / "truth" / f"{job.id}.json")
    return {"id": job.id, "truth": asdict(made.truth), "claims": claims}


def _ask(name: str, made: case.EffortCase) -> EffortClaim:
    if name in TRIVIAL:
        return TRIVIAL[name](made.truth)
    from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts

    begun = time.perf_counter()
    try:
        result = diagnose_efforts(made.recording, wrench=made.recording.has_wrench)
        return of_json(result.diagnosis.to_json(), time.perf_counter() - begun)
    except (WrenchbedError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        spent = time.perf_counter() - begun
        return EffortClaim("error", seconds=spent, error=f"{type(error).__name__}: {error}")
