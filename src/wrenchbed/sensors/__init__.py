"""Force/torque sensors, one file of data a family: ranges, resolutions and measured noise.
Imports physics only.
Read first: `base`, then `ati_gamma` as an example.
"""
