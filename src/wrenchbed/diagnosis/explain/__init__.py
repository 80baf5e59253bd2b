"""Sets of up to three effects ("structures"), their nonlinear refit, claims, verdict, reliability.
Read first: `structures`, then `fit_of_several_recordings` and `refit`, `claims` and `verdict`.
Free: speed and caches; tests/diagnosis/test_refit, test_claims and test_elements judge them.
Others rely on: lessons.jsonl (made by `scripts/learn_reliability`, never by hand; features in the
order of `reliability.NAMES`, `familiarity.NAMES`), `INSEPARABLE` (run `scripts/effects`), words of
`verdict` (docs/contracts.md), `Refitter` (gap, several). After a change of what moves probabilities
(any constant) run `scripts/learn_reliability`, then new sealed cases.
Never: the last word on a claim; `gap` measures it on held-out rows.
"""
