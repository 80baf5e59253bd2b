"""What each effect would add to each reading, and the exact evidence of each hypothesis.
Imports prepare.
Never: refit or judge; it is linear and knows no verdict.
Read first: `dictionary`, then `likelihood` and `search`.
Used by: explain, gap, next, efforts, `diagnose`; benchmark and reports.
"""
