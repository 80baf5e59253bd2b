"""A sensor's noise drawn ahead in blocks, since one row at a time costs as much as hundreds."""

from dataclasses import replace

import numpy as np

from wrenchbed.noise import SATURATED_BITS, NoiseModel, NoiseStream

_BLOCK = 512
_SHORTEST_S = 1e-6


class Hiss:
    """Noise of a sensor that is read on and on.

    A block is drawn at the spacing of the reading that needed it, so that the slow parts keep
    their pace; where the spacing changes, within a block they do not follow.

    Args:
        model: of the noise.
        seed: of the draws.
    """

    def __init__(self, model: NoiseModel, seed: int) -> None:
        self._model = model
        self._stream = NoiseStream(replace(model, resolution=0.0, range=np.inf), seed)  # type: ignore[arg-type]
        self._rows = np.empty((0, 6))
        self._drawn = 0.0
        self._last = 0.0

    def corrupt(self, t: np.ndarray, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Readings (n, 6) and saturated channels (n,) of true loads (n, 6) at t (n,) [s]."""
        n = len(t)
        if len(self._rows) < n:
            self._draw(n, float(t[-1]))
        self._last = float(t[-1])
        measured = wrench + self._rows[:n]
        self._rows = self._rows[n:]
        step, full = self._model.resolution, self._model.range
        rounded = np.rint(measured / np.where(step > 0, step, 1.0)) * step
        measured = np.where(step > 0, rounded, measured)
        status = (np.abs(measured) >= full).astype(np.uint32) @ SATURATED_BITS
        return np.clip(measured, -full, full), status

    def _draw(self, n: int, until: float) -> None:
        """At least n more rows."""
        spacing = max((until - self._last) / n, _SHORTEST_S)
        count = max(_BLOCK, n)
        start = max(self._drawn, self._last)
        times = start + spacing * np.arange(1, count + 1)
        rows, _ = self._stream.corrupt(times, np.zeros((count, 6)))
        self._drawn = float(times[-1])
        self._rows = np.concatenate([self._rows, rows])
