"""ATI Gamma: ranges of its three SI calibrations, and the noise of one Gamma on a robot at rest.

Noise, measured: ``0-steady-state_wrench.csv`` of A. Skrede, NTNU 2024, doi
10.5281/zenodo.11096791 (CC BY 4.0): 698 rows in one second, no clock (698.1 Hz after its sister
recordings), a Gamma with a 0.93 kg load on a KUKA LBR Med 14 that its servos hold at rest.

* Standard deviation of one row (6,), read off directly.
* 1/f: root of the mean of f·S(f) at 1 and 2 Hz, below the arm's lowest visible resonance. It is
  an upper estimate (4 degrees of freedom), since it does not stand out from the white floor.
* White: the rest of the variance. Only tz is truly white at the sensor's own level. In the other
  channels most of it is the arm: visible lines at 3, 9 to 10 and 15 to 16 Hz (fz, fx, ty), 13 Hz
  (fy, tx), 71 to 75 Hz (fx, ty, fy) and 231 to 240 Hz (fy, tx). Counted as white they keep the
  standard deviation, not the colour: octave by octave the density's root is off by up to 6.
* Correlation: of the rows. ty moves with fx at 0.048 N·m/N and tx against fy: the load's lever arm.
* Mains: 50 Hz does not stand out in any channel (p = 0.10 to 0.93), so its amplitude is 0. What a
  sine fits there is 5.8, 1.1, 4.3 mN and 0.018, 0.31, 0.016 mN·m, as at any neighbouring frequency.
* Step: torques lie on a grid of 1e-6 N·m (a Net F/T counts that finely), forces are printed with
  six digits. No channel shows the data sheet's resolution as a step.

Nothing slower than a second was seen: that the 1/f part goes on to 1 mHz is an assumption.
The recording does not name its calibration; ty = −3.04 N·m in ``3-vibrations-contact`` rules out
SI-32-2.5.
"""

import numpy as np

from wrenchbed.sensors.base import Sensor, from_sheet, noise_at_rest

_SHEET = "ATI F/T data sheet, Gamma, 16-bit DAQ; "

SI_32_2_5 = from_sheet(
    "SI-32-2.5",
    (32.0, 100.0, 2.5),
    (1 / 160, 1 / 80, 1 / 2000),
    _SHEET + "1/160 N and 32 N as quoted by the force/torque sensor selection guide of "
    "roboticscenter.ai; the rest from memory, unverified",
)
SI_65_5 = from_sheet(
    "SI-65-5",
    (65.0, 200.0, 5.0),
    (1 / 80, 1 / 40, 10 / 13333),
    _SHEET + "from memory, unverified; public drivers for the older CTL electronics count "
    "20 per N and 333.33 per N·m, the usual four times coarser",
)
SI_130_10 = from_sheet(
    "SI-130-10",
    (130.0, 400.0, 10.0),
    (1 / 40, 1 / 20, 1 / 800),
    _SHEET + "ranges verified in ATI's calibration file of Gamma FT8578 (2014-03-05); "
    "resolution from memory, unverified",
)

NOISE = noise_at_rest(
    white=np.array([0.0351, 0.0210, 0.0749, 0.00116, 0.00187, 0.000247]),
    flicker=np.array([0.00082, 0.00050, 0.0024, 4.1e-5, 2.6e-5, 3.1e-5]),
    correlation=np.array(
        [
            [1.00, -0.13, 0.65, 0.15, 0.90, -0.14],
            [-0.13, 1.00, -0.02, -0.81, -0.02, 0.12],
            [0.65, -0.02, 1.00, 0.07, 0.70, -0.02],
            [0.15, -0.81, 0.07, 1.00, 0.03, -0.12],
            [0.90, -0.02, 0.70, 0.03, 1.00, -0.11],
            [-0.14, 0.12, -0.02, -0.12, -0.11, 1.00],
        ]
    ),
    full_scale=SI_65_5.range,
    step=np.full(6, 1e-6),
)

SENSOR = Sensor(
    name="ati-gamma",
    title="ATI Gamma, six axes, 65 N across and 5 N·m (SI-65-5)",
    calibrations=(SI_32_2_5, SI_65_5, SI_130_10),
    default="SI-65-5",
    mass=0.255,
    mass_source="ATI F/T data sheet, Gamma; from memory, unverified",
    noise=NOISE,
    noise_source="measured: A. Skrede, NTNU 2024, doi 10.5281/zenodo.11096791, steady state; "
    "warm-up 0.1 % of full scale with 15 min, switched on an hour before, estimate",
)
