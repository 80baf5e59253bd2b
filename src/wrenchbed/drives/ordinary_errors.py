"""Errors that every arm has beside its model: of links, of torque sensors, and of its friction law.

A fit counts them in its uncertainties; a diagnosis beside that fit counts them together with what
they changed in the fit.
"""

import numpy as np

from wrenchbed.channels.effort import GAIN
from wrenchbed.channels.holding_torques import LINK_CENTRE, LINK_MASS
from wrenchbed.effects.drives.operators import direction, since_reversal
from wrenchbed.physics.rigid_load_regressor import INERTIAL
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import of_moment

PRESLIDING = 1e-3
"""Travel after a reversal within which friction builds up [rad or m] (Dahl 1976, doi
10.2514/3.61511): bristles of geared joints yield by about this much; estimate."""
_PER_LINK = 4


def by_each(of_links: np.ndarray, after_reversals: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Changes (N, J, H) of J efforts by one error each: of links (N, J, 4 L), of each joint's
    friction after reversals (N, J), and of each torque's gain, the predicted ``total`` (N, J)."""
    own = np.eye(total.shape[1])
    each = (of_links, after_reversals[..., None] * own, GAIN * total[..., None] * own)
    return np.concatenate(each, axis=2)


def of_link(link: int) -> range:
    """Indices of the errors of a link, from 0."""
    return range(_PER_LINK * link, _PER_LINK * (link + 1))


def link_errors(phi: np.ndarray) -> np.ndarray:
    """Changes (10 L, 4 L) of the inertial parameters phi (L, 10) of L links by an ordinary error of
    the mass of each, and of each coordinate of its centre (`LINK_MASS`, `LINK_CENTRE`)."""
    errors = np.zeros((len(phi), INERTIAL, len(phi), _PER_LINK))
    for k, link in enumerate(phi):
        centre = link[1:4] / max(link[0], 1e-9)
        moves = [LINK_CENTRE * link[0] * of_moment(centre, axis) for axis in np.eye(3)]
        errors[k, :, k] = np.transpose([LINK_MASS * link, *moves])
    return errors.reshape(phi.size, -1)


def after_reversal(q: Jet, coulomb: np.ndarray) -> np.ndarray:
    """Change (N, J) of friction that builds up within `PRESLIDING` after a reversal, not at once;
    ``q``: joint values and speeds (N, J), ``coulomb``: friction (J,) [N·m or N]."""
    missing = []
    for angle, speed in zip(q.v.T, q.d.T, strict=True):
        sign = direction(speed)
        missing.append(2.0 * sign * np.exp(-since_reversal(angle, sign) / PRESLIDING))
    return -coulomb * np.stack(missing, axis=1)
