"""Unmodelled effects, one file each; the registry lists the folder.
Imports physics, robots, sensors, and simulation for what an effect writes into MuJoCo.
Never: another effect, a recording or a diagnosis.
Read first: `base` (the contract), then `chain` (how effects act together).
Used by: benchmark, campaigns, diagnosis, hardware, monitoring, plant, reports, twin.
"""

SUPPORT = ("scene", "chain", "drives", "free_form")
"""Modules of this package that are no plug-ins."""
