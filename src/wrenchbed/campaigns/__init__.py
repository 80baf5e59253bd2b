"""The run of one plan on one robot, resumable, and campaigns of many simulated robots.

May import: hardware, diagnosis, calibration, planning, twin and the rooms below them.
Never: print, or move a robot along a way that was not checked first.
Read first: ``run.py`` (`record`), ``moves.py`` (what is checked before) and ``resume.py`` (after a
stop); ``simulated_robots.py`` for many.
Used by: cli.
"""
