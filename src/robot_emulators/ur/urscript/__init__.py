"""The language URScript, without a robot: text to tokens, to a tree, to a program of threads.

A program may only call functions of a table that the robot gives. Nothing is evaluated but the
tree: no Python text is made or run. Free: the inside (tests/emulators/test_urscript.py). Others
rely on: `compiled`, `Machine`, `Table`, values (ur/script_*.py). Never: Python's eval, imports of
ur. Limits in `machine` bound what a program may use. Read first: translation.py, machine.py.
"""
