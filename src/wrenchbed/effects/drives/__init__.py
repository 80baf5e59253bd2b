"""Effects of drives, one file each: what a diagnosis of joint efforts fits in one joint.
Read first: `base` (the contract). The registry lists the folder (kind ``drives``).
Free: the inside of each file (columns of a form); tests/effects/test_drive_effects fits them.
Others rely on: names (docs/contracts.md), units, plausible sizes, words (`diagnosis.efforts`).
Never: import another drive effect, or formulas of `simulation.drives`, which tests it.
"""

SUPPORT = ("lag", "operators", "wave")
"""Modules of this package that are no plug-ins."""
