"""Recordings, plans and their metadata in Parquet; import of CSV files and logs; export to MCAP.

Free: the inside of each file (how files are read and guessed); tests/data speak.
Others rely on: columns, units and metadata of recordings and plans (docs/contracts.md: old files
must still read), the keys of maps (docs/reference/map-keys.md), what an output may replace.
Never: import a robot, a sensor or an effect (a column map names them as text); unpack without a
limit.
Read first: `recording`, then `metadata`; files.checked reads every JSON and TOML file.
"""
