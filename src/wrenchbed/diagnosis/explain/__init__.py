"""Sets of up to three effects ("structures"), their nonlinear refit, claims, verdict, reliability.
Read first: `structures`, then `shared_numbers` and `refit`, `claims` and `verdict`.
Free: speed and caches; tests/diagnosis/test_refit, test_claims and test_elements judge them.
Others rely on: lessons.jsonl (features in the order of `reliability.NAMES`, `familiarity.NAMES`),
`Verdict`, `Refitter` (gap, several). After a change of what moves probabilities (`_TRIALS`,
`_RIDGE`, steps, odds) run `scripts/learn_reliability`.
Never: the last word on a claim; `gap` measures it on held-out rows.
"""
