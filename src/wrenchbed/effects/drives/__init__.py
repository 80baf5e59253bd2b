"""Effects of drives, one file each: what a diagnosis of joint efforts fits in one joint.
Read first: `base` (the contract). The registry lists the folder (kind ``drives``).
Free: numerics; tests/effects/test_drive_effects.py fits columns to the simulator's formula.
Others rely on: names: change docs/contracts.md with them. Units, `Size`, columns, words: run
tests/diagnosis/efforts. Never: import another drive effect, or `simulation.drives`, which tests it.
"""

SUPPORT = ("delay_fit", "operators", "angle_periodic")
"""Modules of this package that are no plug-ins."""
