"""The corrected simulator: a robot in MuJoCo with the effects that a diagnosis identified.
Imports effects, simulation, data, robots, sensors and physics.
Never: evidence or a verdict; it simulates what was decided.
Read first: `twin`, then `mechanics` (what is compliant) and `replay` (what its sensor reads).
Used by: campaigns, cli, diagnosis, exports, hardware, monitoring, plant, reports, viewer.
"""
