"""MuJoCo simulates (`simulation`, `servo_motion`), the closed form fits (`closed_form`).
Imports data, physics and robots.
Never: an effect in the closed form; `effects` change what it is given.
Read first: `closed_form`, then `simulation`; tests hold the two together.
Used by: every room above it but cli and reports.
"""
