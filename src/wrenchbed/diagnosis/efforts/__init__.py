"""Diagnosis of joint torques and motor currents: which joint, which effect, how far.

Imports drives, and what `diagnosis` imports. Read first: `diagnose_efforts`, which walks `scene`,
`columns`, `noise`, `evidence`, `search`, `held_out`, `signs`, `verdict` and
`answer`.
Used by: benchmark, cli and reports.
"""
