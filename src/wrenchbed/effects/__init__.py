"""Unmodelled effects, one file each; the registry lists the folder.
Read first: `base` (the contract), then `chain` (how effects act together).
Free: numerics; tests/effects compares formulas with plain numpy, tests/twin with MuJoCo.
Others rely on: names, sizes and weights (priors: learn again); `scripts/effects` prints docstrings.
Never: another effect, a recording or a diagnosis.
"""

SUPPORT = ("scene", "chain", "drives", "free_form")
"""Modules of this package that are no plug-ins."""
