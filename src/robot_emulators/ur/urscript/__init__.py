"""The language URScript, without a robot: text to tokens, to a tree, to a program of threads.

A program may only call functions of a table that the robot gives. Nothing is evaluated but the
tree: no Python text is made or run. Free: the code inside functions (tests/emulators/
test_urscript.py). Not free: `compiled`, `Machine`, `Table` and values (change ur/script_*.py too),
texts of errors (a controller's), limits in `machine`, which bound what a program may use. Never:
Python's eval, imports of ur. Read first: translation.py, machine.py.
"""
