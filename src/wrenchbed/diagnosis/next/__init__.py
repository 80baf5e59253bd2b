"""Which experiment would separate the causes that a recording cannot.
Imports prepare, evidence and explain.
Never: change an answer; it looks ahead only.
Read first: `experiments`, then `actions`; `dry_run` asks before a recording.
Used by: gap, `diagnose`; cli and reports.
"""
