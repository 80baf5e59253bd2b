"""Formulas of robots in C, built with the package where there is a compiler.
Imports no other folder.
Never: a formula that numpy does not have too; tests compare both.
Read first: `statics`.
Used by: robots, medrue and simulation.
"""
