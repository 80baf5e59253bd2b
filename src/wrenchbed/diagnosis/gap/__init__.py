"""How large the gap is, where it lies, and how far the twin closes it on held-out rows.
Read first: `closure` and `varies_with`, with which `locality` asks about a narrow range of a joint.
Free: speed; tests/diagnosis/test_varies_with, test_held_out, test_claims.
Others rely on: `Closure`, `Judged` (every decision), diagnosis.json (docs/contracts.md). Counts of
draws and levels (`SEEN`) decide claims: after a change sealed cases.
Never: choose a cause; it measures what others claim.
"""
