"""`wrenchbed plan`: choose poses, a motion, or the measurements that reach an accuracy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.overwrite_rules import Kind
from wrenchbed.errors import PlanError
from wrenchbed.files import set_aside


@dataclass(frozen=True)
class PoseArguments:
    """Options of `plan` for poses at rest: number, index that chooses them, pool they are from."""

    n: int = 100  # Number of poses.
    # Observability index to make as large as possible.
    index: Literal["O1", "O2", "O3", "O4", "O5", "A"] | None = None
    # Candidate poses to choose from; 40,000 for an index, 4,000 for a goal or a tracker.
    pool: int | None = None


@dataclass(frozen=True)
class GoalArguments:
    """Options of `plan --goal`: the accuracy to be reached, and touches of known points for it."""

    # Few measurements that reach a position accuracy in the robot's target workspace.
    goal: Literal["target-position"] | None = None
    # With --goal: wanted rms position error [m] of 99 % of robots; 0.0003.
    accuracy: float | None = None
    # With --goal: how far a tip sits from its point, per axis [m]; 5e-5.
    touch_std: float | None = None
    # With --goal: CSV with columns x, y, z [m], known points to touch; a grid if none.
    points: Path | None = None


@dataclass(frozen=True)
class MotionArguments:
    """Options of `plan` for a motion to follow in place of poses: its kind, length and rate."""

    # Poses to rest at, a multi-sine to follow, or with --for dynamics the motion of a serial arm
    # that is best for friction and inertial parameters.
    motion: Literal["poses", "multisine", "excite"] = "poses"
    # pose: poses after which geometry fitted to a tracker's places is best; dynamics: with excite.
    for_: Annotated[Literal["dynamics", "pose"] | None, tyro.conf.arg(name="for")] = None
    seconds: float = 60.0  # Length of a motion.
    rate: float = 125.0  # Sampling rate of a motion [Hz].


def plan(
    robot: tyro.conf.Positional[str],
    /,
    out: Path,
    poses: PoseArguments,
    goal: GoalArguments,
    motion: MotionArguments,
    seed: int = 0,
    as_json: Json = False,
) -> None:
    """Choose poses, or a multi-sine motion, for a robot.

    Without --index, poses are random. With --goal, OUT gets the poses under gravity and
    OUT.touches.parquet the touches of known points that together make the tool accurate.

    Args:
        robot: name, see `wrenchbed list robots`.
        out: Parquet file to write.
        seed: Seed of the random choice.
    """
    console.check_seed(seed)
    console.check_out(out, Kind.PLAN, goal.points)
    if goal.goal is not None:
        console.check_out(_touches(out), Kind.PLAN, goal.points)
    arm = wb.load("robots", robot)
    _check(poses, goal, motion)
    if goal.goal is not None:
        _write_mix(_mix(arm, poses.pool, goal, seed), out, goal.touch_std, as_json)
        return
    chosen = _chosen(arm, poses, motion, seed)
    chosen.write(out)
    what = f"{len(chosen)} poses"
    if chosen.mode == "dynamic":
        what = f"{motion.seconds:g} s at {motion.rate:g} Hz"
    result = {"plan": str(out), "robot": robot, "mode": chosen.mode, "rows": len(chosen)}
    console.answer(result, as_json, f"planned {what} for {robot} → {out}")


def _check(poses: PoseArguments, goal: GoalArguments, motion: MotionArguments) -> None:
    """Raise `PlanError` for options of `plan` that do not go together."""
    if (motion.motion == "excite") != (motion.for_ == "dynamics"):
        raise PlanError("--motion excite goes with --for dynamics")
    for_pose = motion.for_ == "pose"
    if for_pose and (motion.motion != "poses" or poses.index is not None or goal.goal is not None):
        raise PlanError("--for pose chooses its own poses: leave --motion, --index and --goal out")
    if motion.motion != "poses" and (poses.index is not None or goal.goal is not None):
        raise PlanError("choose either poses or a motion: --index and --goal are for poses")
    if goal.goal is not None:
        if poses.index is not None:
            raise PlanError("--goal chooses its own poses; leave --index out")
        return
    extra = next((name for name, value in vars(goal).items() if value is not None), None)
    if extra is not None:
        raise PlanError(f"--{extra.replace('_', '-')} goes with --goal target-position")
    if poses.index is None and poses.pool is not None and not for_pose:
        raise PlanError("--pool goes with --index, --goal or --for pose")


def _mix(arm: wb.Robot, pool: int | None, goal: GoalArguments, seed: int) -> wb.Mix:
    points = None if goal.points is None else wb.read_points(goal.points)
    given: dict[str, Any] = {"pool": pool, "points": points, "touch_std": goal.touch_std}
    stated = {name: value for name, value in given.items() if value is not None}
    accuracy = 3e-4 if goal.accuracy is None else goal.accuracy
    with console.progress("measurements", None) as report:
        return wb.reach(arm, accuracy, **stated, seed=seed, progress=lambda _: report(1))


def _chosen(arm: wb.Robot, poses: PoseArguments, motion: MotionArguments, seed: int) -> wb.Plan:
    if motion.motion == "multisine":
        return wb.multisine(arm, motion.seconds, motion.rate, seed)
    if motion.motion == "excite":
        with console.progress("better motions", None) as report:
            return wb.excite(
                arm, motion.seconds, motion.rate, seed, lambda x: report(1, f"log det {x:.4g}")
            )
    if motion.for_ == "pose":
        pool = 4_000 if poses.pool is None else poses.pool
        with console.progress("exchanges of poses", None) as report:
            return wb.for_tracker(
                arm, poses.n, pool, seed, lambda x: report(1, f"rms {1e3 * x:.3g} mm")
            )
    if poses.index is None:
        return wb.poses(arm, poses.n, seed)
    pool = 40_000 if poses.pool is None else poses.pool
    index = poses.index
    with console.progress("exchanges of poses", None) as report:
        return wb.informative(
            arm, poses.n, index, pool, seed, progress=lambda x: report(1, f"{index} {x:.4g}")
        )


def _touches(out: Path) -> Path:
    """Path of the plan of touches, OUT.touches.parquet, beside the plan OUT."""
    return out.with_name(f"{out.stem}.touches.parquet")


def _write_mix(mix: wb.Mix, out: Path, touch_std: float | None, as_json: bool) -> None:
    beside = _touches(out)
    touched = len(mix.touches) > 0
    mix.gravity.write(out)
    if touched:
        mix.touches.write(beside)
    else:
        set_aside(beside)  # of another plan
    result = {
        "plan": str(out), "robot": mix.gravity.robot, "poses": len(mix.gravity),
        "touches": len(mix.touches), "touch_plan": str(beside) if touched else None,
        "rms_mm": 1e3 * mix.rms, "assured_mm": 1e3 * mix.assured, "before_mm": 1e3 * mix.before,
    }  # fmt: skip
    std = "" if touch_std is None else f" --touch-std {touch_std:g}"
    fit = f" --touches TOUCHES{std}" if touched else ""
    lines = [f"{len(mix.gravity)} poses under gravity → {out}"]
    if touched:
        lines.append(f"{len(mix.touches)} touches of known points → {beside}")
    lines += [
        f"rms position error in the target: expected {1e3 * mix.before:.1f} mm now, "
        f"{1e3 * mix.rms:.3f} mm after; below {1e3 * mix.assured:.3f} mm for "
        f"{mix.share:.0%} of robots",
        f"record, then: wrenchbed calibrate REC{fit} --free candidates sensor.bias --prior",
    ]
    console.answer(result, as_json, "\n".join(lines))
