"""The verb that chooses what to measure."""

from pathlib import Path
from typing import Any, Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.errors import PlanError


def plan(
    robot: tyro.conf.Positional[str],
    /,
    out: Path,
    n: int = 100,
    index: Literal["O1", "O2", "O3", "O4", "O5", "A"] | None = None,
    pool: int | None = None,
    goal: Literal["target-position"] | None = None,
    accuracy: float | None = None,
    touch_cost: float | None = None,
    touch_std: float | None = None,
    least_poses: int | None = None,
    points: Path | None = None,
    motion: Literal["poses", "multisine"] = "poses",
    seconds: float = 60.0,
    rate: float = 125.0,
    seed: int = 0,
    rrd: Path | None = None,
    as_json: Json = False,
) -> None:
    """Choose poses, or a multi-sine motion, for a robot.

    Without --index, poses are random. With --goal, OUT gets the poses under gravity and
    OUT.touches.parquet the touches of known points that together make the tool accurate.

    Args:
        robot: name, see `wrenchbed list robots`.
        out: Parquet file to write.
        n: Number of poses.
        index: Observability index to make as large as possible.
        pool: Candidate poses to choose from; 40,000 for an index, 4,000 for a goal.
        goal: Few measurements that reach a position accuracy in the robot's target workspace.
        accuracy: With --goal: wanted rms position error [m] of 99 % of robots; 0.0003.
        touch_cost: With --goal: what a touch costs, in poses under gravity; 1.
        touch_std: With --goal: how far a tip sits from its point, per axis [m]; 5e-5.
        least_poses: With --goal: poses under gravity at least, which calibrate the sensor; 6.
        points: With --goal: CSV with columns x, y, z [m], known points to touch; a grid if none.
        motion: Poses to rest at, or a multi-sine to follow.
        seconds: Length of a motion.
        rate: Sampling rate of a motion [Hz].
        seed: Of the random choice.
        rrd: Also write the plan as a picture for rerun: the way, poses, expected wrenches.
        as_json: Print the result as JSON.
    """
    console.check_seed(seed)
    console.check_out(rrd, out)
    arm = wb.load("robots", robot)
    if motion != "poses" and (index is not None or goal is not None):
        raise PlanError("choose either poses or a motion: --index and --goal are for poses")
    if goal is not None and index is not None:
        raise PlanError("--goal chooses its own poses; leave --index out")
    wanted: dict[str, Any] = {
        "accuracy": accuracy, "touch_cost": touch_cost, "touch_std": touch_std,
        "least_poses": least_poses,
    }  # fmt: skip
    given = {k: v for k, v in wanted.items() if v is not None}
    if goal is None and (given or points is not None):
        name = next(iter(given), "points").replace("_", "-")
        raise PlanError(f"--{name} goes with --goal target-position")
    if goal is None and index is None and pool is not None:
        raise PlanError("--pool goes with --index or --goal")
    if goal is not None:
        known = None if points is None else wb.read_points(points)
        size = 4_000 if pool is None else pool
        with console.progress("measurements", None) as tell:
            mix = wb.reach(
                arm, **{"accuracy": 3e-4, **given}, points=known, pool=size, seed=seed,
                tell=lambda _: tell(1),
            )  # fmt: skip
        _answer_mix(mix, out, touch_std, as_json)
        _draw(mix.gravity, rrd)
        return
    if motion == "multisine":
        chosen = wb.multisine(arm, seconds, rate, seed)
    elif index is None:
        chosen = wb.poses(arm, n, seed)
    else:
        chosen = wb.informative(arm, n, index, 40_000 if pool is None else pool, seed)
    chosen.write(out)
    _draw(chosen, rrd)
    what = f"{len(chosen)} poses" if motion == "poses" else f"{seconds:g} s at {rate:g} Hz"
    result = {"plan": str(out), "robot": robot, "mode": chosen.mode, "rows": len(chosen)}
    console.answer(result, as_json, f"planned {what} for {robot} → {out}")


def _draw(chosen: wb.Plan, rrd: Path | None) -> None:
    if rrd is not None:
        from wrenchbed.viewer import plan_view

        plan_view(chosen, rrd)


def _answer_mix(mix: wb.Mix, out: Path, touch_std: float | None, as_json: bool) -> None:
    beside = out.with_name(f"{out.stem}.touches.parquet")
    if beside.exists():
        beside.replace(beside.with_name(beside.name + "~"))  # of another plan
    mix.gravity.write(out)
    touched = len(mix.touches) > 0
    if touched:
        mix.touches.write(beside)
    result = {
        "plan": str(out), "robot": mix.gravity.robot, "poses": len(mix.gravity),
        "touches": len(mix.touches), "touch_plan": str(beside) if touched else None,
        "rms_mm": 1e3 * mix.rms, "assured_mm": 1e3 * mix.assured, "before_mm": 1e3 * mix.before,
    }  # fmt: skip
    known = "" if touch_std is None else f" --touch-std {touch_std:g}"
    fit = f" --touches TOUCHES{known}" if touched else ""
    lines = [f"{len(mix.gravity)} poses under gravity → {out}"]
    if touched:
        lines.append(f"{len(mix.touches)} touches of known points → {beside}")
    lines += [
        f"rms position error in the target: expected {1e3 * mix.before:.1f} mm now, "
        f"{1e3 * mix.rms:.3f} mm after; below {1e3 * mix.assured:.3f} mm for "
        f"{100 * mix.share:g} % of robots",
        f"record, then: wrenchbed calibrate REC{fit} --free candidates sensor.bias --prior",
    ]
    console.answer(result, as_json, "\n".join(lines))
