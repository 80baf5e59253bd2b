"""The robot behind the emulators: MuJoCo in real time, with effects, noise, drives and contact.
Free: the inside of each file (how a cycle is computed, if it keeps real time);
tests/emulators/test_emulated_body.py speaks.
Others rely on: robot_emulators' interface (`Plant`, `PlantRequest`), which only this room and
`registry` use; `contact_surface` (environments), seeds of `sensor`.
Never: a protocol; the emulators speak, this room moves.
Read first: serving.py, then body.py."""
