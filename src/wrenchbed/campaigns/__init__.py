"""The run of one plan on one robot, resumable, and campaigns of many simulated robots.

Free: the inside of each file (order of checks and wording); tests/campaigns speak.
Others rely on: metadata and segments of recordings (`resume`, monitoring), columns of
robots.parquet (docs/how-to/campaigns.md); row k is a function of settings and k alone.
Never: print, or move a robot along a path that was not checked first.
Read first: ``run.py`` (`record`), ``moves.py`` (what is checked before) and ``resume.py`` (after a
stop); ``simulated_robots.py`` for many.
"""
