"""Choice of poses and motions: optimal designs, and checks that a way touches nothing.
May import: calibration, simulation, robots, data, physics.
Never: a recording; a plan rests on the nominal robot and stated tolerances.
Read first: `choose`; then `accuracy_plan` for few measurements that reach an accuracy.
Used by: benchmark, campaigns, cli, diagnosis, monitoring, studies.
"""
