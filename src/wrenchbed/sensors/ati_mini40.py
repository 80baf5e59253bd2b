"""ATI Mini40: ranges of its SI calibrations, certified accuracy and an estimate of its noise.

Noise, an estimate: six equal gauges with independent noise, seen through a real calibration
matrix (FT12288), which gives the ratios between the channels and their correlation. One number
sets the level: 0.87 mV a gauge, the geometric mean over fx, fy, fz and tz of a published standard
deviation at rest divided by the norm of the matrix's row. That deviation is the median over six
recordings of 3.8 s at 1 kHz of a Mini40 IP68, SI-40-2, FT56491 in a bending rig (Jimenez Lab,
"Bender ATI Mini40 Baseline Noise Diagnostics", 2026-07-20, Section 3b; raw data not seen):

    fx 0.0152, fy 0.0143, fz 0.0293 N; tx 0.43, ty 0.74, tz 0.29 mN·m  (measured)
    fx 0.0150, fy 0.0153, fz 0.0314 N; tx 0.37, ty 0.37, tz 0.26 mN·m  (gauges)

ty is twice the gauges' and differs most between recordings (0.36 to 0.94): the rig, not the sensor.
The same notes find the matrices of SI-40-2 and SI-20-1 within 9 % of each other: gauges and
amplifier are the same, so the level is taken for every calibration. The 1/f part is 1/8 of the
white one, as in the Gamma's tz, its only channel that the robot does not shake, and adds 5 % to the
row's standard deviation. Mains: none known. Step: the data sheet's, about one step of a 16-bit
converter of ±10 V seen through the matrix (0.005, 0.011 N, 0.13 mN·m).
"""

import numpy as np

from wrenchbed.sensors.base import Sensor, from_sheet, gauge_noise, noise_at_rest

_SHEET = "ATI F/T data sheet, Mini40, 16-bit DAQ; "

SI_20_1 = from_sheet(
    "SI-20-1",
    (20.0, 60.0, 1.0),
    (1 / 200, 1 / 100, 1 / 8000),
    _SHEET + "verified against the table in the public data set "
    "sahandrez/aml_robot_cutting_dataset (README), a second hand",
)
SI_40_2 = from_sheet(
    "SI-40-2",
    (40.0, 120.0, 2.0),
    (1 / 100, 1 / 50, 1 / 4000),
    _SHEET + "resolution verified against the table in Jimenez Lab's noise diagnostics, a "
    "second hand; ranges from memory, unverified",
)
SI_80_4 = from_sheet(
    "SI-80-4",
    (80.0, 240.0, 4.0),
    (1 / 50, 1 / 25, 1 / 2000),
    _SHEET + "ranges verified in ATI's calibration file of Mini40 FT12288 (2012-04-05); "
    "resolution from memory, unverified",
)

MATRIX = np.array(
    [
        [0.19037, -0.11786, -0.25881, 12.10519, -0.20147, -12.31599],
        [0.35074, -14.40147, -0.00762, 6.86552, 0.09975, 7.28170],
        [20.65160, -0.25683, 20.77931, -0.46231, 20.97702, -0.17059],
        [0.00435, -0.07842, 0.29874, 0.03454, -0.29471, 0.03757],
        [-0.33789, 0.00216, 0.16911, -0.06854, 0.17676, 0.06755],
        [0.00722, -0.17308, 0.00001, -0.16902, -0.00098, -0.17197],
    ]
)
"""Gauges [V] to wrench [N, N·m] of Mini40 FT12288, SI-80-4: rows of ATI's calibration file divided
by their scale, then by its ``BasicTransform``, 5.3594 mm along z."""

GAUGE_STD = 0.87e-3
"""Noise of one gauge [V], see above."""

_STD, _CORRELATION = gauge_noise(MATRIX)

NOISE = noise_at_rest(
    white=GAUGE_STD * _STD,
    flicker=GAUGE_STD * _STD / 8,
    correlation=_CORRELATION,
    full_scale=SI_20_1.range,
    step=SI_20_1.resolution,
)

SENSOR = Sensor(
    name="ati-mini40",
    title="ATI Mini40, six axes, 20 N across and 1 N·m (SI-20-1)",
    calibrations=(SI_20_1, SI_40_2, SI_80_4),
    default="SI-20-1",
    mass=0.0499,
    mass_source="ATI F/T data sheet, Mini40; from memory, unverified",
    noise=NOISE,
    noise_source="estimate from a calibration matrix and published standard deviations at rest, "
    "see the module; warm-up 0.1 % of full scale with 15 min, switched on an hour before, estimate",
    accuracy=np.array([0.25, 0.2, 0.45, 0.0125, 0.0125, 0.02]),
    accuracy_source="maker's certificate of one Mini40 as quoted by Joubair et al. 2016, "
    "doi 10.3390/s16060798, Section 5; it does not name the calibration, 1.25 % and 2 % of SI-20-1",
)
