"""Formulas of robots in C, built with the package where there is a compiler.

Free: the inside of each function (speed); tests/robots/test_compiled.py compares it with numpy.
Others rely on: the order of constants, shared by ``_statics.c``, `_LAYOUT` and each robot's
`packed`: change all three, then run `scripts/build_kernel.py`.
Never: a formula that numpy does not have too. Read first: `statics`.
"""
