"""Structures of up to three effects, their nonlinear refit, claims, verdict, reliability.
Imports prepare and evidence.
Read first: `analysis`, then `structures` and `verdict`.
"""
