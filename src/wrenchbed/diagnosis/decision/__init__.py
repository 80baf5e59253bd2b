"""What may be said: options, rivals on held-out rows, and the one decision.
Read first: `decide`.
Free: speed. Rules and numbers: first docs/explanation/decision.md and tests/diagnosis/test_decide,
then `scripts/learn_reliability` and sealed cases. docs/contracts.md fixes `MOST_RIVALS`, `LEAST`,
`LARGEST_NONE` and `MOST`.
Others rely on: names in `RULES` (`scripts/ablations`), odds.
Never: a rule on verdicts elsewhere; `decide` is pure, knows `Facts` alone and has the last word.
"""
