"""What the article prints: "Calculation of Installation Error for Six-Axis Force Sensors in Robotic
Applications", Tables 1 to 6; it names no author and no DOI."""

import numpy as np

DIRECTIONS = ("right", "up", "backward", "down", "left")
METHODS = ("Method 1", "Method 2", "Method 3")
FORCE = {
    "right": (0.0189, 3.6908, 5.1165), "up": (0.0120, 4.4279, 5.9899),
    "backward": (0.1808, 9.5964, 6.1964), "down": (0.0060, 11.5635, 10.3358),
    "left": (0.0085, 8.6540, 5.6913),
}  # fmt: skip
"""Geometric mean of the force's magnitude by method [N]."""
TORQUE = {
    "right": (0.0122, 0.4353, 0.1034), "up": (0.0038, 0.4464, 0.0507),
    "backward": (0.0077, 0.3589, 0.1234), "down": (0.0082, 0.6394, 0.2247),
    "left": (0.0051, 0.4811, 0.0789),
}  # fmt: skip
"""Geometric mean of the torque's magnitude by method [N·m]."""
TABLE = {"right": 2, "up": 3, "backward": 4, "down": 5, "left": 6}

ALPHA = np.array([0.0, np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2])
"""Twists of its Table 1, which puts a link's twist one row too low for the transform it prints."""
