"""What may be said: options, rivals on held-out rows, and the one decision.
Imports evidence, explain and gap.
Never: a rule on verdicts elsewhere; `decide` is pure, knows `Facts` alone and has the last word.
Read first: `decide`.
Used by: `diagnose`, efforts; reports.
"""
