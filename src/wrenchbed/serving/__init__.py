"""What every twin shares: the robot in MuJoCo in real time, its sensor, timed faults, its life."""
