"""A recording run: one plan on one robot, checked before it moves, tried again, resumable.

May import: hardware, planning, data, robots, physics, errors.
Read first: ``run.py`` (`record`), then ``itinerary.py`` (moves) and ``resume.py`` (after a stop).
Used by: cli.
"""
