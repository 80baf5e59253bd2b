"""What each effect would add to each reading, and the exact evidence of each hypothesis.
Imports prepare.
Read first: `dictionary`, then `likelihood` and `search`.
Used by: explain, gap, next, efforts, `diagnose`; benchmark and reports.
"""
