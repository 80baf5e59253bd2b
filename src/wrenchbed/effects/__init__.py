"""Unmodelled effects, one file each; the registry lists the folder. Read first: `base`, `chain`.
Free: numerics of a formula; tests/effects compares it with numpy, tests/twin with MuJoCo.
Others rely on: names: change docs/contracts.md and `benchmark/fault.py` with them. Titles,
docstrings, parameters: run `scripts/effects`. Attributes, variants: test_effect_declarations.py
of tests/effects writes tests/data anew. Sizes, weights, `form_error`: then also run
`scripts/learn_reliability`.
Never: import another effect, a recording or a diagnosis.
"""

SUPPORT = ("scene", "chain", "drives", "by_channel")
"""Modules of this package that are no plug-ins."""
