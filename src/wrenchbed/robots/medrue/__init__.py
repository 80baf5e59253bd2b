"""MedRUE, a hybrid six-axis medical robot: Joubair et al. 2016, doi 10.3390/s16060798.

Free: the inside of functions; tests/robots/test_medrue.py and test_compiled.py judge it.
Others rely on: names and tolerances of the 49 parameters (effects, priors of fits), the name
``medrue``, poses of `inverse_kinematics`: after a change run `scripts/studies`.
Never: a number without the paper, or ``models/medrue/README.md``, as its source.
Read first: `robot`, then `kinematics`.
"""

from wrenchbed.robots.medrue.robot import MedRUE

ROBOT = MedRUE()
