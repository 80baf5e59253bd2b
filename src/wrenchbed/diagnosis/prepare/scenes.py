"""Scene of a recording or of a plan, and the part of a long recording that is diagnosed.

A scene holds the rows that were measured and the ways between them. A motion's cost grows with its
rows (1 ms and 30 kB each); at rest, and in motion without joints, rows are averaged. Effects
between rows are searched in a limited number of the rows themselves.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrenchbed.calibration.observations import Observations
from wrenchbed.data.clock import pieces
from wrenchbed.data.holds import gather, runs
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.effects.scene import WAY, Scene
from wrenchbed.physics.taylor_jets import Value, value
from wrenchbed.simulation.closed_form import Model

MOTION = 60_000
"""Rows of a motion with joints that are diagnosed: 8 min at 125 Hz."""
ROWS = 1_000_000
"""Rows in which effects between rows are looked for: enough for a variance within 0.1 %."""
LEAST_IN_HOLD, RUNS = 200, 100
"""Fewest last rows of each pose in an excerpt; with fewer it has this number of even runs."""


def of_poses(
    model: Model, robot_theta: np.ndarray, q: np.ndarray, t: np.ndarray, warmth: np.ndarray | None
) -> Scene:
    """Scene of poses at rest q (H, J) at times t (H,) [s], joined by straight joint-space moves;
    ``warmth`` (H,): temperature above the recording's first [K], None if not known."""
    gravity = np.asarray(model.gravity)
    if not model.robot.joints or len(q) < 2:
        return Scene(model.robot, robot_theta, gravity, q, t, np.ones(len(q), dtype=bool), warmth)
    progress = np.arange(WAY + 1) / (WAY + 1)

    def fill(x: np.ndarray) -> np.ndarray:
        steps = np.diff(x, axis=0)
        part = progress.reshape((1, -1) + (1,) * (x.ndim - 1))
        ways = x[:-1, None] + part * steps[:, None]
        return np.concatenate([ways.reshape(-1, *x.shape[1:]), x[-1:]])

    held = np.zeros((len(q) - 1) * (WAY + 1) + 1, dtype=bool)
    held[:: WAY + 1] = True
    warm = None if warmth is None else fill(warmth)
    return Scene(model.robot, robot_theta, gravity, fill(q), fill(t), held, warm)


def of_motion(
    model: Model, robot_theta: np.ndarray, q: Value, t: np.ndarray, warmth: np.ndarray | None
) -> Scene:
    """Scene of a motion's samples q (N, J), jets, or orientations (N, 4), at times t (N,) [s];
    ``warmth`` (N,): temperature above the recording's first [K], None if not known."""
    held = np.ones(len(value(q)), dtype=bool)
    return Scene(model.robot, robot_theta, np.asarray(model.gravity), q, t, held, warmth)


def of_recording(recording: Recording, configuration: Configuration, data: Observations) -> Scene:
    """Scene whose measured rows (``held``) are the observations of a recording."""
    warmth = None
    if "temperature" in recording.columns:
        temperature = recording.columns["temperature"].astype(float)
        warmth = np.interp(data.t, recording.t, temperature - temperature[0])
    make = of_motion if recording.metadata.mode == "dynamic" else of_poses
    return make(configuration.model, configuration.robot_theta, data.q, data.t, warmth)


def stretch(recording: Recording) -> Recording:
    """Longest piece without a gap of a motion with joints, at most its middle `MOTION` rows."""
    if recording.metadata.mode != "dynamic" or not recording.joints:
        return recording
    parts = pieces(recording.columns)
    if len(parts) > 1:
        recording = at_rows(recording, max(parts, key=lambda part: part.stop - part.start))
    spare = len(recording) - MOTION
    if spare <= 0:
        return recording
    return at_rows(recording, slice(spare // 2, spare // 2 + MOTION))


def excerpt(recording: Recording) -> Recording:
    """At most `ROWS` rows of a recording, in runs without a gap.

    At rest the last rows of every pose, because the tool may ring after a move, or evenly spread
    runs if these would be few; in motion one run from the middle.
    """
    n = len(recording)
    if n <= ROWS:
        return recording
    if recording.metadata.mode == "dynamic":
        return at_rows(recording, slice((n - ROWS) // 2, (n - ROWS) // 2 + ROWS))
    count = gather(recording, np.ones(n, dtype=bool)).count
    last = ROWS // len(count)
    if last >= LEAST_IN_HOLD:
        return at_rows(recording, np.repeat(np.cumsum(count), count) - np.arange(n) <= last)
    size = ROWS // RUNS
    begins = np.linspace(0, n - size, RUNS).astype(int)
    return at_rows(recording, (begins[:, None] + np.arange(size)).ravel())


def longest(recording: Recording, keep: np.ndarray) -> Recording:
    """Recording of the longest run of marked rows ``keep`` (N,)."""
    begin, end = max(runs(keep), key=lambda run: run[1] - run[0])
    return at_rows(recording, slice(begin, end))


def notes(given: Recording, used: Recording, looked: Recording) -> Sequence[str]:
    """Notes on rows of ``given`` that are not ``used``, else on those not ``looked`` at singly."""
    if len(used) < len(given):
        first, last = used.t[0] - given.t[0], used.t[-1] - given.t[0]
        return (
            f"of {len(given):,} rows of motion, {len(used):,} were diagnosed, from {first:.0f} s "
            f"to {last:.0f} s: what happens outside it, or over longer times, is not seen",
        )
    if len(looked) < len(used):
        share = f"{len(looked):,} of {len(used):,} rows"
        return (f"what happens between rows was looked for in {share}, next to each other",)
    return ()


def at_rows(recording: Recording, keep: slice | np.ndarray) -> Recording:
    """Recording of the rows ``keep`` alone: a slice, a mask or indices."""
    return replace(recording, columns={k: v[keep] for k, v in recording.columns.items()})
