"""What reads a force/torque sensor, one file or folder a device."""
