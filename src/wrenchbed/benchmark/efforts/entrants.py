"""Arms of the efforts' benchmark, and what entrants say of its cases: rows of truth and claims."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.benchmark.efforts import case
from wrenchbed.benchmark.efforts.case import EffortTruth, name_of
from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.diagnosis.gap.result import named_by
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


def claim_of(raw: Mapping[str, Any]) -> Claim:
    """The claim of a `diagnosis.json`; names of effects end with their joint.

    Raises:
        KeyError, TypeError, ValueError: it is not of the contract's form.
    """
    which, odds = list(raw["which"]), raw.get("probabilities", {})
    return Claim(
        str(raw["verdict"]),
        tuple(_class(entry) for entry in which),
        {n: float(odds.get(n, 0.0)) for n in ("none", "unknown")},
        tuple(float(entry["probability"]) for entry in which),
    )


def _class(entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Effects with joints that an entry of ``which`` claims as one class."""
    joint = entry.get("parameters", {}).get(JOINT)
    joints: list[int | None] = [None]
    if joint is not None:
        at = joint if isinstance(joint, int) else joint["value"]
        others = [] if isinstance(joint, int) else joint.get("rivals", [])
        joints = [int(at), *(int(j) for j in others)]
    effects = list(named_by(entry))
    if len(effects) > MOST:
        raise ValueError(f"the class of {effects[0]} has more than {MOST} members")
    return tuple(_named(e, j) for e in effects for j in joints)


def _named(effect: str, joint: int | None) -> str:
    """Name with the joint of a drive or link, which may be in it already."""
    if joint is None or effect.rpartition(".")[2].isdigit():
        return effect
    return name_of((effect, joint if effect.startswith(("drive.", "link.")) else None))


def always_none(_: EffortTruth) -> Claim:
    """Claim that nothing is wrong."""
    return Claim("none", (), {"none": 1.0})


def oracle(truth: EffortTruth) -> Claim:
    """Claim of the truth itself."""
    if truth.kind == "none":
        return always_none(truth)
    if truth.kind == "outside":
        return Claim("unknown", (), {"unknown": 1.0})
    name = name_of((truth.family, truth.joint))
    return Claim("identified", ((name,),), {name: 1.0}, (1.0,))


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
    claims = {name: _asked(name, made) for name in job.entrants}
    if job.keep is not None:
        made.write(job.keep / f"{job.id}.parquet", job.keep / "truth" / f"{job.id}.json")
    return {"id": job.id, "truth": asdict(made.truth), "claims": claims}


def _asked(name: str, made: case.EffortCase) -> dict[str, Any]:
    """An entrant's claim as JSON, with the seconds that it took and its error."""
    if name in TRIVIAL:
        return asdict(TRIVIAL[name](made.truth)) | {"seconds": 0.0, "error": ""}
    from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts

    begun, error = time.perf_counter(), ""
    try:
        result = diagnose_efforts(made.recording, wrench=made.recording.has_wrench)
        claim = claim_of(result.diagnosis.to_json())
    except (WrenchbedError, ArithmeticError, LookupError, TypeError, ValueError) as problem:
        claim, error = Claim("error", (), {}), f"{type(problem).__name__}: {problem}"
    return asdict(claim) | {"seconds": time.perf_counter() - begun, "error": error}
