"""Recordings, plans and their metadata in Parquet; import of CSV files and logs; export to MCAP.
May import: physics and the root files.
Never: import a robot, a sensor or an effect; a column map names them as text.
Read first: `recording`, then `metadata`; `checked` reads every JSON and TOML file.
Used by: every room that reads or writes recordings or plans; not effects, robots, sensors.
"""
