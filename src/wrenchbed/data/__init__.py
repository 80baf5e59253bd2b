"""Recordings, plans and their metadata in Parquet; import of CSV files and logs; export to MCAP.

Read first: `recording`, then `metadata`; files.checked reads every JSON and TOML file.
Free: the inside of each file (how files are read, clocks evened, holds found); tests/data judge it.
Others rely on: columns, units and metadata of recordings and plans (docs/contracts.md: old files
must still read), keys of maps (docs/reference/map-keys.md), `maps/` (names of `--map`,
tests/data/test_ready_maps.py), and what an output may replace (`outputs`).
Never: import a robot, a sensor or an effect (a map names them as text); unpack without a limit.
"""
