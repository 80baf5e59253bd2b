"""Judges of the diagnosis: look-alike cases, the independent referee, sealed cases, scores.
Free: sizes, shapes and wording of drawn faults, as long as tests/benchmark pass.
Others rely on: names in `fault.EFFECTS` (tests/effects); draws: a change of any makes other cases
of the same seed, one of `lookalikes` needs new lessons (`scripts/learn_reliability`); files of
`sealed` (docs/contracts.md) and keys of `arena` (docs/how-to/arena.md).
Never: import effects or the diagnosis into `referee`, `lookalikes` or `efforts` (a test sees to
it); change a lesson or a commitment by hand.
Read first: `scoring/metrics` (what is scored), then `sealed/make` and `referee/case`.
"""
