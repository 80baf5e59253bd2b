"""Colours that mean something: measured or simulated, which axis, how much to blame."""

import numpy as np

MEASURED = (40, 140, 220)
"""Blue: what a robot's sensor said; as in reports, and told from orange by everybody."""
SIMULATED = (230, 110, 20)
"""Orange: what a simulator says."""
OTHERS = ((0, 158, 115), (170, 110, 190), (225, 190, 60))
"""Further simulators beside the first."""
NEXT = (13, 148, 136)
"""Teal: what to do next."""
XYZ = ((220, 38, 38), (22, 163, 74), (37, 99, 235))
JOINTS = (
    (31, 119, 180), (255, 127, 14), (44, 160, 44),
    (214, 39, 40), (148, 103, 189), (140, 86, 75),
)  # fmt: skip
GHOST_ALPHA = 80
_LEAST = (0.89, 0.90, 0.91)
"""Of a part that nothing is wrong with: light grey."""
_RAMP = np.array(
    [_LEAST, (0.99, 0.84, 0.42), (0.98, 0.62, 0.28), (0.86, 0.27, 0.26), (0.50, 0.04, 0.16)]
)
"""Light grey, yellow, orange, red, dark red: darker the worse, also without colour."""


def heat(share: np.ndarray | float) -> np.ndarray:
    """Colours (…, 3) of 0 … 255 for shares (…,) of 0 … 1."""
    at = np.clip(np.asarray(share, dtype=float), 0.0, 1.0) * (len(_RAMP) - 1)
    low = np.minimum(at.astype(int), len(_RAMP) - 2)
    part = (at - low)[..., None]
    mixed = _RAMP[low] * (1.0 - part) + _RAMP[low + 1] * part
    return np.rint(255.0 * mixed).astype(np.uint8)


def ghost(colour: tuple[int, int, int]) -> tuple[int, int, int, int]:
    """A colour that one sees through."""
    return (*colour, GHOST_ALPHA)
