"""Weighted least squares for a robot's parameters, and what the data can identify.
May import: simulation (closed form), robots, sensors, data, physics, pages (numbers).
Never: MuJoCo, effects or a diagnosis; a fit to its own simulation proves nothing.
Read first: `calibrate`; then `problem` (what is fitted) and `weighting` (with which weights).
Used by: benchmark, campaigns, cli, diagnosis, drives, environments, monitoring, planning,
reports, studies.
"""
