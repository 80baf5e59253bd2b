"""Diagnosis of the gap between a simulator and a recording: where, which effect, how far.
Imports physics, data, robots, sensors, simulation, effects, calibration, planning and twin.
Never: MuJoCo but through `twin`, nor a name of an effect where `Effect` can be asked.
Read first: `diagnose`, which walks prepare, evidence, explain, gap, between_rows and next.
Used by: benchmark, campaigns, cli, reports, viewer.
"""
