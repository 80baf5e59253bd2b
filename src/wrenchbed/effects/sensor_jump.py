"""Effect ``sensor.jump``: the sensor's zero jumps, once or a few times."""

from collections.abc import Sequence

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import ReadingEffect, Residual, Values, Variant, per_channel, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter

MOMENTS = 24
"""Largest number of moments at which a search for one jump begins: a search takes as long for
each."""
STEPS = per_channel("step")
MOST = 3
"""Largest number of jumps: of more, each has few rows, and a drift is as good."""
SCANNED = 200
"""Largest number of moments between which a scan chooses those of several jumps: all of most
recordings at rest, and two or three a second in motion."""
LEAST_FIRST = 0.1
"""Share of the squared residual that one jump explains at least where there are several; measured:
with 0.5 two of the twenty of tests/diagnosis/test_misleading_recordings.py are missed."""
_BEFORE = 1e-3
"""Part of the time between two poses by which a jump within one begins before its mean time: far
below what readings tell, so that the pose itself is behind it; by definition."""
RISE_S = 0.2
"""Duration of a step in motion from which a fit begins [s]: several rows, so that the readings have
a slope by its moment."""
EXPLAINED = 0.5
"""Share of what the jumps before it leave that a further one explains at least."""


def _named(k: int) -> tuple[str, tuple[str, ...]]:
    """Name of the k-th jump's moment (k from 1), then names (6,) of its steps."""
    return ("time", STEPS) if k == 1 else (f"time{k}", per_channel(f"step{k}"))


JUMPS = tuple(_named(k) for k in range(1, MOST + 1))


class SensorJump(ReadingEffect):
    """y_i → y_i + s_i from ``time`` [s] on, a moment of the recording's clock; further jumps have
    ``step2.fx``, ``time2``, and so on. The first row from ``time`` on has a ``part`` of the step:
    the mean of a pose in which the zero jumps. In motion each step takes a time ``rise`` [s], half
    of it before its moment: what slips or recovers settles.

    Seen in: varied orientations before and after its moment.
    """

    name = "sensor.jump"
    title = "the sensor's zero jumps"
    channelwise = True
    rough = True
    zero_is_convention = True
    shown = "time"
    once = True
    source = "overload, a slipped bolt, or zeroed again, 0.2–5 N: estimate"
    numbers = (
        *(
            p
            for time, steps in JUMPS
            for p in (
                *by_channel.parameters(steps[0].partition(".")[0], 0.5, 0.02, "jump of the zero"),
                Parameter(time, 0.0, "s", 60.0, text="of the jump, as the recording's"),
            )
        ),
        Parameter("part", 1.0, "1", 0.5, 0.0, 1.0, "of the step in the first row after it"),
        Parameter("rise", 0.0, "s", 0.2, 0.0, 5.0, "duration of each step"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        """Variants with one jump, at moments midway between two measured rows, spread evenly."""
        t = scene.t[scene.held]
        midway = (t[1:] + t[:-1]) / 2.0
        count = min(MOMENTS, len(midway))
        chosen = ((np.arange(count) + 0.5) * len(midway) / max(count, 1)).astype(int)
        rise = {"rise": RISE_S} if scene.moving else {}
        return tuple(
            Variant(label, steps, {"time": float(moment)} | rise, ("time", *rise))
            for moment in midway[chosen]
            for label, steps in (("forces", STEPS[:3]), ("all channels", STEPS))
        )

    def scan(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """Variants of two or more jumps, while each one more halves the squared residual."""
        t = scene.t[residual.rows]
        if residual.fitted is None or len(t) < 2 * (MOST + 1):
            return ()
        after = np.unique(np.linspace(1, len(t) - 1, min(SCANNED, len(t) - 1)).astype(int))
        first = _explained(residual.value, residual.fitted, after)
        if first.max() < LEAST_FIRST * float((residual.value**2).sum()):
            return ()
        rows, chosen = [int(after[int(first.argmax())])], list[int]()
        energy = float((residual.value**2).sum() - first.max())
        for _ in range(MOST - 1):
            rows, remaining = _placed(residual.value, residual.fitted, after, rows)
            if remaining < EXPLAINED * energy:
                chosen = rows
            energy = remaining
        if not chosen:
            return ()
        if len(chosen) == 2 and abs(chosen[1] - chosen[0]) == 1:  # about one pose: within it
            before, here = t[min(chosen) - 1], t[min(chosen)]
            at = {"time": float(here - _BEFORE * (here - before)), "part": 0.5}
            return (Variant(f"within the pose at {here:.0f} s", STEPS, at, ("time", "part")),)
        at = {JUMPS[k][0]: float(t[i - 1] + t[i]) / 2.0 for k, i in enumerate(sorted(chosen))}
        free = tuple(name for _, steps in JUMPS[: len(chosen)] for name in steps)
        moments = ", ".join(f"{x:.0f}" for x in at.values())
        at |= {"rise": RISE_S} if scene.moving else {}
        return (Variant(f"near {moments} s, all channels", free, at, tuple(at)),)

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        for time, steps in JUMPS:
            if any(p[name] for name in steps):
                since = scene.t - p[time]
                after = (since >= 0.0).astype(float)
                if p["rise"]:
                    after = np.clip(0.5 + since / p["rise"], 0.0, 1.0)
                elif (time, steps) == JUMPS[0]:
                    after[np.flatnonzero(scene.held & (after > 0.0))[:1]] = p["part"]
                reading = reading + after[:, None] * vector(p, steps)
        return reading


def _placed(
    value: np.ndarray, fitted: np.ndarray, after: np.ndarray, chosen: Sequence[int]
) -> tuple[list[int], float]:
    """Add one jump to ``chosen`` ones (their first rows), move each to its best of rows ``after``;
    return rows and squared residual of ``value`` (R, 6) with the basis ``fitted`` (R, 6, k)."""
    rows, remaining = [*chosen, 0], np.inf
    for k in [len(chosen), *range(len(chosen)), len(chosen)]:
        rest, basis = value, fitted
        for other in (row for i, row in enumerate(rows) if i != k and row):
            rest, basis = _without(rest, basis, other)
        gains = _explained(rest, basis, after)
        rows[k] = int(after[int(gains.argmax())])
        remaining = float((rest**2).sum() - gains.max())
    return rows, remaining


def _explained(rest: np.ndarray, basis: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Squared residual (M,) that one more jump explains, for each of M first rows ``after`` it;
    ``rest``: residual (R, 6), orthogonal to the orthonormal ``basis`` (R, 6, k) fitted already."""
    inside = np.cumsum(basis[::-1], axis=0)[::-1][after]  # (M, 6, k)
    along = np.cumsum(rest[::-1], axis=0)[::-1][after]  # (M, 6)
    count = (len(rest) - after)[:, None, None] * np.eye(6)
    normal = count - inside @ np.swapaxes(inside, 1, 2) + 1e-9 * count
    return np.asarray(
        np.einsum("mi,mi->m", along, np.linalg.solve(normal, along[..., None])[..., 0])
    )


def _without(rest: np.ndarray, basis: np.ndarray, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Residual (R, 6) once a jump at ``row`` is fitted too, and the basis with it (R, 6, k + 6)."""
    step = np.zeros((*rest.shape, 6))
    step[row:] = np.eye(6)
    known, step = basis.reshape(rest.size, -1), step.reshape(rest.size, 6)
    more = np.linalg.qr(step - known @ (known.T @ step))[0]
    remaining = rest.ravel() - more @ (more.T @ rest.ravel())
    return remaining.reshape(rest.shape), np.column_stack([known, more]).reshape(*rest.shape, -1)


EFFECT = SensorJump()
