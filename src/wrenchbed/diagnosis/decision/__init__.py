"""What may be said: options, rivals on held-out rows, and the one decision.
Imports evidence, explain and gap.
Read first: `decide`.
Used by: `diagnose`, efforts; reports.
"""
