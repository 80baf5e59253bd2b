"""MedRUE's 49 parameters: Joubair et al. 2016, doi 10.3390/s16060798, Section 3 and Table 1, in SI.

The paper prints 46 in its table; δq1, d31, d32 stand in its list only and have no printed value
(0 here). d31, d32 appear in none of its equations: here they are the pins between each five-bar's
plane and its universal joint, which move geometry but neither the tool nor the wrench.
"""

import numpy as np

from wrenchbed.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import load_parameters

_LENGTH_ERROR = 2e-3
_ANGLE_ERROR = np.deg2rad(1.0)  # Section 5: ±2 mm, ±1°

_MM = {
    "A1y": -233.0, "A1z": 178.0, "C1y": -83.0, "C1z": 438.0,
    "A2y": -233.0, "A2z": 178.0, "C2y": -83.0, "C2z": 438.0,
    "L11": 400.0, "L12": 520.0, "L13": 400.0, "L14": 520.0,
    "L21": 400.0, "L22": 520.0, "L23": 400.0, "L24": 520.0,
    "d41": 41.5, "d42": 41.5, "d5": 0.0, "xT": 0.0, "yT": 0.0, "zT": 134.6,
    "x0": 109.0, "y0": 139.0, "z0": -31.0, "xS": 41.5, "yS": 0.0, "zS": 41.7,
    "xG": 0.0, "yG": 0.0, "zG": 152.4, "dq1": 0.0, "d31": 0.0, "d32": 0.0,
}  # fmt: skip
_DEG = {
    "alphaT": 67.512, "betaT": 0.0, "gammaT": 0.0, "alpha0": 0.0, "beta0": 0.0, "gamma0": 0.0,
    "dq2": 0.0, "dq3": 0.0, "dq4": 0.0, "dq5": 0.0, "dq6": 0.0,
    "alphaS": -67.512, "betaS": 0.0, "gammaS": 0.0,
}  # fmt: skip
_ORDER = (
    "A1y A1z C1y C1z A2y A2z C2y C2z L11 L12 L13 L14 L21 L22 L23 L24 d41 d42 d5 xT yT zT alphaT "
    "betaT gammaT x0 y0 z0 alpha0 beta0 gamma0 dq2 dq3 dq4 dq5 dq6 xS yS zS alphaS betaS gammaS "
    "xG yG zG mTool dq1 d31 d32"
).split()
_TEXT = {
    "A": "anchor of a five-bar's first proximal link, base frame",
    "C": "anchor of a five-bar's second proximal link, base frame",
    "L": "link length",
    "d4": "x offset of a universal joint",
    "d5": "wrist origin along the wrist's x",
    "d3": "pin between a five-bar's plane and its universal joint",
    "dq": "zero offset of an active joint",
    "T": "tool frame in the sensor frame",
    "0": "base frame in the world",
    "S": "sensor frame in the wrist frame",
    "G": "centre of gravity in the wrist frame",
}


def _text(name: str) -> str:
    for key in (name[:2], name[:1], name[-1:]):
        if key in _TEXT:
            return _TEXT[key]
    return ""


def _parameter(name: str) -> Parameter:
    if name == "mTool":
        return Parameter(name, 0.365, "kg", 0.01, 0.001, 10.0, "mass on the sensor")
    if name in _MM:
        nominal = _MM[name] / 1e3
        lower = 0.05 if name.startswith("L") else -3.0
        return Parameter(name, nominal, "m", _LENGTH_ERROR, lower, 3.0, _text(name))
    return Parameter(name, np.deg2rad(_DEG[name]), "rad", _ANGLE_ERROR, -6.3, 6.3, _text(name))


PAPER = ParameterSet(tuple(_parameter(name) for name in _ORDER))
"""The paper's 49 parameters."""

PROBE_INERTIA = (7e-4, 7e-4, 2e-4, 0.0, 0.0, 0.0)
"""Estimate [kg·m²]: a 0.365 kg rod of 0.15 m; the paper, at rest, needs none."""

PARAMETERS = PAPER + load_parameters(PROBE_INERTIA)

IDENTIFIED = (
    "A1z C1y A2y A2z C2z L11 L12 L13 L14 L21 L22 L24 d41 beta0 gamma0 dq2 dq3 dq4 dq5 dq6 "
    "alphaS betaS gammaS xG yG zG mTool"
).split()
"""The 27 that Table 1 really identifies (A1y and C1z are unstarred but frozen there)."""
