"""Recordings, plans and their metadata in Parquet; import of CSV files and logs; export to MCAP.
May import: physics and the root files.
Read first: `recording`, then `metadata`; `checked` reads every JSON and TOML file.
"""
