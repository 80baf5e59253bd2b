"""MuJoCo simulates (`simulation`, `servo_motion`), the closed form fits (`closed_form`).
Imports data, physics and robots.
Read first: `closed_form`, then `simulation`; tests hold the two together.
Used by: every room above it but cli and reports.
"""
