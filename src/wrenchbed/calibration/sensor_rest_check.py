"""Check that a recording at rest allows a sensor's noise to be learnt; refusals say why not."""

from collections.abc import Iterator

import numpy as np

from wrenchbed.data.holds import split
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError, RecordingError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.sensors.base import STATUS_SATURATED

LEAST_ROWS, LEAST_S = 256, 0.9
"""Fewest rows and shortest time of a rest: fewer rows tell a standard deviation to no better than 5
%, and less time than about 1 s no colour below 1 Hz. A minute is meant."""
_UNEVEN, _GAP = 0.2, 2.5
"""Largest standard deviation of the time steps, and largest single step, over the median step:
jitter of an ordinary logger passes, two lost rows do not."""
_BLOCKS, _JUMP = 60, 14.0
"""Number of blocks into which a rest is cut, a second each of a minute, and largest change of their
means over the median change (Gaussian noise: 9 sigma, once in 10^17; 1/f noise less)."""


def check_rest(recording: Recording) -> float:
    """Return the rate [Hz] of a recording at rest from which noise can be learnt; a
    `CalibrationError` says why another is none: too short, moving, uneven, saturated, disturbed or
    dead."""
    for reason in _reasons(recording):
        raise CalibrationError(f"{recording.name}: {reason}")
    return float((len(recording) - 1) / (recording.t[-1] - recording.t[0]))


def _reasons(recording: Recording) -> Iterator[str]:
    """Yield reasons why no noise can be learnt from a recording; none if it is a rest."""
    t = recording.t
    seconds = float(t[-1] - t[0]) if len(t) > 1 else 0.0
    if len(t) < LEAST_ROWS or seconds < LEAST_S:
        yield (
            f"{len(t)} rows in {seconds:.3g} s are too short to learn noise from: at least "
            f"{LEAST_ROWS} rows and {LEAST_S:g} s are needed; record a minute at rest"
        )
    steps = np.diff(t)
    usual, longest = float(np.median(steps)), int(np.argmax(steps))
    if steps[longest] > _GAP * usual:
        yield (
            f"row {longest + 1} comes {steps[longest]:.3g} s after the one before, others after "
            f"{usual:.3g} s: rows are missing there; the colour of the noise needs an even clock. "
            "Record again without gaps"
        )
    if steps.std() > _UNEVEN * usual:
        yield (
            f"the clock is uneven: steps of {usual:.3g} s scatter by {steps.std():.2g} s; the "
            "colour of the noise needs an even one"
        )
    yield from _moves(recording)
    marked = recording.columns.get("status", np.zeros(len(t))).astype(np.int64) & STATUS_SATURATED
    if marked.any():
        yield (
            f"column 'status', row {int(np.argmax(marked > 0))}: the sensor is saturated in "
            f"{np.count_nonzero(marked)} rows; take the load off it"
        )
    for channel, rows in zip(CHANNELS, recording.wrench.T, strict=True):
        if np.ptp(rows) == 0.0:
            yield (
                f"column {channel!r} is {rows[0]:g} in all rows: its step hides its noise, or it "
                "reads nothing"
            )
        yield from _touches(t, channel, rows)


def _moves(recording: Recording) -> Iterator[str]:
    where = "record a minute at rest, in one pose"
    try:
        holds = split(recording)
    except RecordingError:
        yield f"the robot moves all the time: {where}"
        return
    if holds.moves or len(holds.seconds) > 1:
        moving = np.flatnonzero(holds.hold < 0)
        inside = moving[(moving > np.argmax(holds.hold >= 0))]
        row = int(inside[0]) if len(inside) else int(moving[0])
        yield f"the robot moves, for instance in row {row} ({holds.sentence}): {where}"


def _touches(t: np.ndarray, channel: str, rows: np.ndarray) -> Iterator[str]:
    size = len(rows) // _BLOCKS
    means = rows[: size * _BLOCKS].reshape(_BLOCKS, size).mean(axis=1)
    change = np.abs(np.diff(means))
    least = float(rows.std()) / size  # where a coarse step leaves most means alike
    usual = max(float(np.median(change)), least)
    worst = int(np.argmax(change))
    if change[worst] > _JUMP * usual:
        row = (worst + 1) * size
        yield (
            f"column {channel!r} jumps by {change[worst]:.3g} near row {row} ({t[row]:.3g} s), "
            f"usually it changes by {usual:.2g}: something touched the tool, or it moved. Record "
            "again without a touch"
        )
