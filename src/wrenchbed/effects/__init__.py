"""Unmodelled effects, one file each; the registry lists the folder.
Read first: `base` (the contract), then `chain` (how effects act together).
Free: the inside of each file (numerics); tests/effects compares formulas with plain numpy,
tests/twin with MuJoCo.
Others rely on: names, docstrings (`scripts/effects`), traits as `rough` (tests/data), sizes and
weights (`scripts/learn_reliability`).
Never: another effect, a recording or a diagnosis.
"""

SUPPORT = ("scene", "chain", "drives", "free_form")
"""Modules of this package that are no plug-ins."""
