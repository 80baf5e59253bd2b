"""Force/torque sensors, one TOML file each: ranges, resolutions, noise, body, sources.
Imports physics and files.
Never: a number without its ``source``.
Read first: `base`, then `ati-gamma.toml` as an example; `described` checks and writes such files.
Used by: calibration, diagnosis, monitoring; the registry, for all others.
"""

SUPPORT = ("described",)
"""Modules that are no plug-in."""
