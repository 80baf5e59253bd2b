"""The noise of many sensors of one kind along one clock: to the last bit `NoiseStream`'s of each.

The 1/f parts of all are stepped together, row by row; alone each would need a filter a rest.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wrenchbed.physics.noise import Array, NoiseModel, NoiseStream

_ROWS_AT_ONCE = 50
"""Rows whose random numbers are drawn together: those of 25 sensors, half a megabyte, stay in a
cache; estimate."""


def corrupt_each(
    model: NoiseModel, seeds: Sequence[int], t: Array, load: Array
) -> tuple[Array, NDArray[np.uint32]]:
    """What many sensors of one kind measure of their own loads.

    Args:
        model: of every sensor.
        seeds: of each (R,), not negative.
        t: (N,) [s].
        load: true loads (R, 6, N) [N, N·m].

    Returns:
        Measured wrenches (R, 6, N) and status words (R, N), see `NoiseStream.corrupt`.
    """
    streams = [NoiseStream(model, seed) for seed in seeds]
    wander = _wander(streams, t) if model.flicker.any() else None
    measured, status = np.empty(load.shape), np.empty((len(seeds), len(t)), dtype=np.uint32)
    for r, stream in enumerate(streams):
        rows, status[r] = stream.add(t, load[r].T, None if wander is None else wander[r])
        measured[r] = rows.T
    return measured, status


def _wander(streams: Sequence[NoiseStream], t: Array) -> Array:
    """`NoiseStream.wander` of each, from its beginning on (R, 6, N)."""
    keep, kick, which = streams[0].steps(t)
    shape = (len(streams), keep.shape[1], 6)
    wide = [np.ascontiguousarray(np.broadcast_to(k[:, None], shape)) for k in keep]
    total = np.empty((len(streams), 6, len(t)))
    state, carried = np.zeros(shape), np.empty(shape)
    drawn = np.empty((_ROWS_AT_ONCE, *shape))
    for first in range(0, len(t), _ROWS_AT_ONCE):
        step = which[first : first + _ROWS_AT_ONCE]
        normal = drawn[: len(step)]
        for r, stream in enumerate(streams):
            normal[:, r] = stream.normals(len(step))
        normal *= kick[step][:, None, :, None]
        for row, s in zip(normal, step.tolist(), strict=True):
            np.multiply(wide[s], state, out=carried)
            row += carried
            state = row
        state = state.copy()
        total[:, :, first : first + len(step)] = normal.sum(axis=2).transpose(1, 2, 0)
    return total
