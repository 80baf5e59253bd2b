"""Force/torque sensors, one file a family: data-sheet ranges, resolutions and measured noise."""
