"""Finds a column map for files: what the columns are, and in which conventions they are written.

Free: the inside of functions. Order and costs of what is tried, and limits, are tuned:
tests/data/test_guess.py and test_conventions.py judge them. Others rely on: the map that is written
(docs/reference/map-keys.md: each key must stand there), lines of `Guess` (the terminal's text),
attributes' texts of `Stated` (help of `import --guess`: run `scripts/command_line`).
Never: write a recording; this folder writes the map, and the import reads that.
Read first: `guess`; `column_roles` says which column is what, `convention` how well one fits.
"""
