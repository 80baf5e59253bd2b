"""How large the gap is, where it lies, and how far the twin closes it on held-out rows.
Read first: `held_out` and `varies_with`.
Free: speed; tests/diagnosis/test_varies_with, test_held_out and test_claims judge it.
Others rely on: `Closure`, `Judged` (every decision), names in `Finding.variable` and keys of gaps
(change docs/contracts.md with them). Constants (`DRAWS`, `SEEN`, `CHANGES` …) decide claims: after
a change run new sealed cases (docs/how-to/sealed.md).
Never: choose a cause; it measures what others claim.
"""
