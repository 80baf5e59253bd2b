"""What shows only between rows: noise, quantisation, stale rows, vibration, contact."""
