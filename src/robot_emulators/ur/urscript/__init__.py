"""The language URScript, without a robot: text to tokens, to a tree, to a program of threads.

What a program may call is a table of functions that the robot gives. Nothing is evaluated but the
tree: no Python text is made or run.
Imports: none of the package.
Never: Python's eval or a module of the robot; what a program may call is handed in.
Read first: translation.py, then machine.py.
"""
