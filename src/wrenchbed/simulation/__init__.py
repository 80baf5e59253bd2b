"""MuJoCo simulates (`mujoco_wrench`, `servo_motion`), the closed form fits (`closed_form`).
Read first: `closed_form`, then `mujoco_wrench`; tests hold the two together.
Free: the inside of each file (speed, caches); tests/robots compares formulas, C and MuJoCo.
Others rely on: names and order of the sensor's parameters (a change makes fit.json and twin.json of
users unreadable); names of springs: change `twin.added_compliance`; order of `constants`: change
`_statics.c` with it, and run `scripts/build_kernel.py`.
Never: an effect (imperfection) in the closed form; `effects` change its inputs and outputs."""
