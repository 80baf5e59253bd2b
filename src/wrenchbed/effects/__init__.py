"""Unmodelled effects, one file each; the registry lists the folder.
Read first: `base` (the contract), then `chain` (how effects act together).
Free: the inside of each file (numerics); tests/effects compares formulas with plain numpy,
tests/twin with MuJoCo.
Others rely on: names (docs/contracts.md, `benchmark/fault.py`), docstrings (`scripts/effects`),
traits and variants (tests/data), sizes, weights (`scripts/learn_reliability`).
Never: import another effect, a recording or a diagnosis.
"""

SUPPORT = ("scene", "chain", "drives", "free_form")
"""Modules of this package that are no plug-ins."""
