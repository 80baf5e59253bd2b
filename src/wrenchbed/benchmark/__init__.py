"""Judges of the diagnosis: look-alike cases, the independent referee, sealed cases, scores.
Free: sizes, shapes and wording of drawn faults; tests/benchmark speak.
Others rely on: a change of `lookalikes` needs new lessons (`scripts/learn_reliability`); a change
of any draw makes other cases of the same seed; docs/contracts.md has the files of `sealed`.
Never: import effects or the diagnosis into `referee`, `lookalikes` or `efforts` (a test sees to
it); change a lesson or a commitment by hand.
Read first: `scoring/metrics` (what is scored), then `sealed/make` and `referee/case`.
"""
