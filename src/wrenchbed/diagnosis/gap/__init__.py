"""How large the gap is, where it lies, and how far the twin closes it on held-out rows.
Imports prepare, evidence and explain.
Never: choose a cause; it measures what others claim.
Read first: `result` (the answer), then `closure` and `where`.
Used by: efforts, `diagnose`; reports.
"""
