"""The run of one plan on one robot, resumable, and campaigns of many simulated robots.
Free: the inside of each file (order of checks and wording); tests/campaigns speak.
Others rely on: metadata and segments of recordings, which `resume` and monitoring read (a change
must keep reading older files); columns of robots.parquet: change docs/how-to/campaigns.md with
them; row k is a function of settings and k alone (seeds too: old folders are completed by them).
Never: print, or move a robot along a path that was not checked first.
Read first: ``run.py`` (`record`), ``moves.py`` (what is checked before) and ``resume.py`` (after a
stop); ``monte_carlo.py`` for many."""
