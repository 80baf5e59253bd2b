"""What moves a real or simulated robot and what reads its force/torque sensor."""
