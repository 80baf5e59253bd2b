"""Recordings, plans and their metadata in Parquet; import of CSV files and logs; export to MCAP.

Read first: `recording`, then `metadata`; files.checked reads every JSON and TOML file.
Free: the inside of functions; constants of `clock`, `holds` and tilts are tuned: tests/data judges.
Others rely on: columns, units, metadata (docs/contracts.md: old files must still read), keys of
maps (change docs/reference/map-keys.md with them), `maps/` (names of `--map`, see
tests/data/test_ready_maps.py), `overwrite_rules` (fields of other rooms' files), errors
(`scripts/messages`).
Never: import a robot, a sensor or an effect (a map names them as text); unpack without a limit.
"""
