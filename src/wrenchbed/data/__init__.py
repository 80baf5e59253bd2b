"""Recordings, plans and their metadata in Parquet; import of CSV files and logs; export to MCAP."""
