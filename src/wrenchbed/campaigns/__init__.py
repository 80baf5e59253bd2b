"""Campaigns of many simulated robots, and (folder ``recording``) the run of one plan on one robot.

May import: hardware, diagnosis, calibration, planning, twin and the rooms below them.
Read first: ``recording/run.py`` for one plan's run; ``simulated_robots.py`` for many.
Used by: cli.
"""
