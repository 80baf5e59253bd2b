"""The robot behind the emulators: MuJoCo in real time, with effects, noise, drives and contact.
Free: the inside of each file (how a cycle is computed, if it keeps real time);
tests/emulators/test_emulated_body.py speaks.
Others rely on: `Plant` and `PlantRequest` of robot_emulators, which this room serves: change both
together; `contact_surface` (environments); seeds of `sensor`, for runs that repeat.
Never: a protocol; the emulators speak, this room moves.
Read first: serving.py, then body.py."""
