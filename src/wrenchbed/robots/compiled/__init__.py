"""Formulas of robots in C, built with the package where there is a compiler.
Imports no other folder.
Read first: `statics`.
Used by: robots, medrue and simulation.
"""
