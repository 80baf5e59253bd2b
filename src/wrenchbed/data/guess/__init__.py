"""Finds a column map for files: what the columns are, and in which conventions they are written.

Free: the inside of each file (order and cost of what is tried); tests/data/test_guess.py and
test_conventions.py judge it.
Others rely on: the map that is written (docs/reference/map-keys.md), lines of `Guess` (cli),
attributes' texts of `Stated` (help of `import --guess`; then run `scripts/command_line`).
Never: write a recording; this folder writes the map, and the import reads that.
Read first: `guess`; `sheets` says which column is what, `convention` how well one fits.
"""
