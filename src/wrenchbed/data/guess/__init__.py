"""A column map found by itself: what the columns are, and in which conventions they are written.
May import: what lies in `data` outside this folder.
Never: write a recording by itself; it writes the map, and the import reads that.
Read first: `guess`; `sheets` says which column is what, `convention` how well one fits.
Used by: cli, for ``import --guess``.
"""
