"""MedRUE's moving bodies: masses and centres of gravity as in ``models/medrue/medrue.xml``.

The masses are estimates (``models/medrue/README.md``): the paper has none.
"""

import numpy as np

from wrenchbed.frames import euler
from wrenchbed.gravity import Link, masses
from wrenchbed.robots.base import Values
from wrenchbed.robots.medrue.kinematics import FiveBar, five_bar, support

_NEAR, _FAR = (0.0, 0.2, 0.0), (0.0, 0.26, 0.0)
_CENTRE = (0.0, 0.0, 0.0)

CARRIAGE = Link("carriage", 14.0, (0.0, -0.16, 0.3))
BARS = tuple(
    (
        Link(f"proximal_a{i}", 1.2, _NEAR),
        Link(f"distal_b{i}", 0.8, _FAR),
        Link(f"proximal_c{i}", 1.2, _NEAR),
        Link(f"distal_d{i}", 0.9, _FAR),
    )
    for i in (1, 2)
)
"""Of five-bars 1 and 2: A–B, B–E, C–D, D–E, y along the link, x that of the base."""
SUPPORT = (
    Link("roll", 0.15, _CENTRE),
    Link("yoke", 0.05, _CENTRE),
    Link("wrist", 0.4, _CENTRE),
    Link("slider", 0.05, _CENTRE),
)
"""At E1, E1, the wrist's origin and E2, their centres of gravity there."""
LINKS = (CARRIAGE, *BARS[0], *BARS[1], *SUPPORT)

_MASSES = masses(LINKS)


def links(p: Values, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masses (13,) [kg] of `LINKS` and their centres of gravity in the world (N, 13, 3) [m]."""
    bars = [five_bar(p, i, q[:, 2 * i - 1], q[:, 2 * i]) for i in (1, 2)]
    e1, e2, _, origin = support(p, q, *bars)
    x = q[:, 0] + p["dq1"]
    inner = np.empty((3, len(LINKS), len(q)))
    inner[:, 0] = np.array(CARRIAGE.cog)[:, None]
    inner[0, 0] += x
    _place(p, 1, x - p["d41"] - p["d31"], bars[0], inner[:, 1:5])
    _place(p, 2, x + p["d42"] + p["d32"], bars[1], inner[:, 5:9])
    for k, point in enumerate((e1, e1, origin, e2), start=9):
        inner[:, k] = point.T
    base = euler(p["alpha0"], p["beta0"], p["gamma0"])
    centres = base @ inner.reshape(3, -1) + base_origin(p)[:, None]
    return _MASSES, centres.reshape(inner.shape).T


def base_origin(p: Values) -> np.ndarray:
    """The base's origin in the world (3,) [m]."""
    return np.array([p["x0"], p["y0"], p["z0"]])


def _place(p: Values, i: int, x: np.ndarray, bar: FiveBar, centres: np.ndarray) -> None:
    """Write the CoGs (3, 4, N) of five-bar i, its plane at x (N,), in base axes."""
    a, c = (np.array([p[f"{anchor}{i}y"], p[f"{anchor}{i}z"]]) for anchor in "AC")
    ends = ((a, bar.B), (bar.B, bar.E), (c, bar.D), (bar.D, bar.E))
    for k, (link, (start, end)) in enumerate(zip(BARS[i - 1], ends, strict=True)):
        along = (end - start) / p[f"L{i}{k + 1}"]
        off, reach, across = link.cog
        centres[0, k] = x + off
        centres[1, k] = start[..., 0] + reach * along[:, 0] - across * along[:, 1]
        centres[2, k] = start[..., 1] + reach * along[:, 1] + across * along[:, 0]
