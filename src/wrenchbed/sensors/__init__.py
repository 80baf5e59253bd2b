"""Force/torque sensors, one TOML file each: ranges, resolutions, noise, body, sources.
Free: new sensors (add a row to docs/reference/sensors.md), the inside of functions. Others rely on
each number of a shipped TOML (calibration, simulated cases, that page): tests/sensors judges.
Names, keys of TOML and `described.rebuilt`: users' files and recordings must still load.
Never: a number without its ``source``.
Read first: `base`, then `ati-gamma.toml` as an example; `described` checks and writes such files.
"""

SUPPORT = ("described",)
"""Modules of this package that are no plug-in; `registry` skips them."""
