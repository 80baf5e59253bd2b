"""Structures of up to three effects, their nonlinear refit, claims, verdict, reliability.
Imports prepare and evidence.
Never: the last word on a claim; `gap` measures it on rows that no fit here saw.
Read first: `structures`, then `shared_numbers` and `refit`, `claims` and `verdict`.
Used by: gap, next, efforts, `diagnose`; benchmark, cli and reports.
"""
