"""What may be said: options, rivals on held-out rows, and the one decision.
Read first: `decide`.
Free: speed. Before a rule or number change docs/explanation/decision.md and
tests/diagnosis/test_decide; then run `scripts/learn_reliability` and new sealed cases.
docs/contracts.md fixes `MOST_RIVALS`, `LEAST`, `LARGEST_NONE` and `MOST`.
Others rely on: names in `RULES` and fields of `Facts` (run `scripts/ablations`), `small` (reports).
Never: a rule on verdicts elsewhere; `decide` is pure, knows `Facts` alone and has the last word.
"""
