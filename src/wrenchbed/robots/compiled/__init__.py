"""Formulas of robots in C, built with the package where there is a compiler.

Free: the inside of each file (speed); tests/robots/test_compiled.py compares it with numpy.
Others rely on: the order of constants, which ``_statics.c`` and each robot's `packed` share.
Never: a formula that numpy does not have too.
Read first: `statics`.
"""
