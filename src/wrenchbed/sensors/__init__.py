"""Force/torque sensors, one TOML file each: ranges, resolutions, noise, body, sources.
Free: a new sensor is a new file; tests/sensors/test_sensors.py judges all.
Others rely on: names, noise and ranges (calibration, diagnosis, emulators;
docs/reference/sensors.md); recordings carry users' sensors (`described.rebuilt`).
Never: a number without its ``source``.
Read first: `base`, then `ati-gamma.toml` as an example; `described` checks and writes such
files."""

SUPPORT = ("described",)
"""Modules of this package that are no plug-in; `registry` skips them."""
