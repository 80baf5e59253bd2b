"""The monthly check of one robot: its poses, its history, what changed and why.
May import: effects, planning, simulation, pages and the rooms below them.
Read first: `check`; then `history` (the file), `quantities` (what a check measures), `trends`
(when something changed) and `causes` (why).
"""
