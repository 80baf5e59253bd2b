"""A recording made ready: checks, noise, blocks, held-out rows, baseline calibration."""
