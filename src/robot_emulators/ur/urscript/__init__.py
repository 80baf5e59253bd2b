"""The language URScript, without a robot: text to tokens, to a tree, to a program of threads.

What a program may call is a table of functions that the robot gives. Nothing is evaluated but the
tree: no Python text is made or run.
Never: Python's eval, a module of the robot or of the package. Limits of `machine` bound what a
program may use. Read first: translation.py, then machine.py.
"""
