"""Effects of drives, one file each: what a diagnosis of joint efforts fits in one joint.

The registry lists the folder (kind ``drives``). Read first: `base` (the contract).
May import: physics. Never: another drive effect, or `simulation.drives`, which tests it.
Used by: diagnosis and reports.
"""

SUPPORT = ("lag", "operators", "wave")
"""Modules of this package that are no plug-ins."""
