"""The robot behind the emulators: MuJoCo in real time, with effects, noise, drives and contact.
Imports: twin, effects, simulation, robots, sensors, physics, registry, errors; the door of
robot_emulators, which alone of all rooms this one knows.
Never: a protocol; the emulators speak, this room moves.
Read first: serving.py, then body.py.
Used by: cli, for ``emulate``; environments.
"""
