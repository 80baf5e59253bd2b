"""Whether the tool touches something, as URScript's tool_contact tells."""

import numpy as np

CONTACT_FORCE = 10.0
"""Force against the direction of motion from which the tool touches something [N]."""
_CYCLES_BACK = 3


def touching(wrench: np.ndarray, direction: np.ndarray) -> int:
    """Cycles since something began to push against a direction; 0 where nothing does.

    Args:
        wrench: at the tool, base axes (6,) [N, N·m].
        direction: of the base axes, any length; its first three of (6,) count.
    """
    length = float(np.linalg.norm(direction[:3]))
    if length < 1e-9:
        return 0
    against = -float(wrench[:3] @ direction[:3]) / length
    return _CYCLES_BACK if against > CONTACT_FORCE else 0
