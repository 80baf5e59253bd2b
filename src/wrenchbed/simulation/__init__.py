"""MuJoCo simulates (`simulation`, `servo_motion`), the closed form fits (`closed_form`).
Read first: `closed_form`, then `simulation`; tests hold the two together.
Free: the inside of each file (speed, caches); tests/robots compares formulas, C and MuJoCo.
Others rely on: names and order of the sensor's parameters (fit.json, twin.json), names of springs
(`twin.mechanics`), the constants of C (`_statics.c`, then `scripts/build_kernel.py`).
Never: an effect (imperfection) in the closed form; `effects` change its inputs and outputs."""
