"""Structures of up to three effects, their nonlinear refit, claims, verdict, reliability.
Imports prepare and evidence.
Read first: `structures`, then `shared_numbers` and `refit`, `claims` and `verdict`.
Used by: gap, next, efforts, `diagnose`; benchmark, cli and reports.
"""
