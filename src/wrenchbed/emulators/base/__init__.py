"""What every emulator shares: the robot in MuJoCo in real time, its sensor, timed faults."""
