"""Choice of poses and motions: optimal designs, and checks that a way touches nothing.
May import: calibration, simulation, robots, data, physics.
Read first: `choose`; then `accuracy_plan` for few measurements that reach an accuracy.
Used by: benchmark, campaigns, cli, diagnosis, monitoring, studies.
"""
