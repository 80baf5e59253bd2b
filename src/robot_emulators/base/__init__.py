"""What every emulator shares: life cycle, event loop, real time, faults, the robot and its sensor.
Imports: twin, effects, simulation, robots, physics, data, registry, errors.
Read first: emulator.py, then body.py.
"""
