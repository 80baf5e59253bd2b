"""Figures that the paper prints: Joubair et al. 2016, doi 10.3390/s16060798."""

import numpy as np

NOISY = {
    "A1z": 178.659, "C1y": -84.002, "A2y": -232.294, "A2z": 177.485, "C2z": 438.210,
    "L11": 400.742, "L12": 520.321, "L13": 398.502, "L14": 520.271, "L21": 399.774,
    "L22": 518.505, "L24": 520.460, "d41": 41.657, "beta0": 0.531, "gamma0": -0.176,
    "dq2": 0.342, "dq3": -0.014, "dq4": 0.529, "dq5": 0.173, "dq6": 0.097,
    "alphaS": -67.430, "betaS": -0.528, "gammaS": 0.196, "xG": 0.571, "yG": 0.042,
    "zG": 153.136, "mTool": 0.365,
}  # fmt: skip
"""Table 1, identified with measurement errors [mm, °, kg]."""
ACTUAL = {
    "A1z": 178.612, "C1y": -84.005, "A2y": -232.267, "A2z": 177.325, "C2z": 438.112,
    "L11": 400.730, "L12": 520.221, "L13": 398.485, "L14": 520.332, "L21": 399.799,
    "L22": 518.336, "L24": 520.445, "d41": 41.660, "beta0": 0.525, "gamma0": -0.134,
    "dq2": 0.313, "dq3": -0.052, "dq4": 0.500, "dq5": 0.135, "dq6": 0.102,
    "alphaS": -67.397, "betaS": -0.525, "gammaS": 0.185, "xG": 0.576, "yG": 0.059,
    "zG": 153.132, "mTool": 0.365,
}  # fmt: skip
"""Table 1, the simulated robot [mm, °, kg]."""
ELIMINATED = {"C2y", "L23", "d42", "xS", "yS", "zS", "A1y", "C1z"}
"""What Table 1 freezes beside the parameters without effect; A1y and C1z without a star."""
AFTER = {"mean": 0.2771, "max": 0.320, "std": 0.0157}
"""Target workspace after calibration [mm]: abstract and Section 5."""
BEFORE = {"mean": 9.03, "max": 12.2, "std": 1.65}
"""Target workspace before: from the above and Table 3's improvements [mm]."""
WHOLE_MEAN = (8.9135, 0.286)
"""Mean over the whole workspace before and after [mm]; Section 5 calls it the target's."""
IMPROVEMENT = {
    ("force", "whole"): (99.43, 99.29, 99.34), ("torque", "whole"): (100.0, 99.43, 100.0),
    ("force", "target"): (98.31, 98.73, 99.24), ("torque", "target"): (96.36, 96.70, 100.0),
    ("position", "whole"): (96.79, 97.72, 98.57), ("position", "target"): (96.93, 97.38, 99.05),
}  # fmt: skip
"""Tables 2 and 3: improvement of mean, maximum and standard deviation [%]."""
T_STATISTIC = {("O1", "O2"): -655.874, ("O1", "O5"): -304.773, ("O2", "O5"): 421.3063}
"""Table 5."""
ITERATIONS = 5


def rms_after() -> float:
    """Root mean square of the published errors in the target [mm]."""
    return float(np.hypot(AFTER["mean"], AFTER["std"]))
