"""The installation error of a force sensor on a UR5, run again on a simulated one."""
