"""MuJoCo simulates (`simulation`, `servo_motion`), the closed form fits (`closed_form`).
Read first: `closed_form`, then `simulation`; tests hold the two together.
Free: the inside of each file (speed and caches); tests/robots compares closed form, compiled C and
MuJoCo.
Others rely on: names and order of the sensor's parameters (fit.json, twin.json), names of springs.
Never: an effect (imperfection) in the closed form; `effects` change its inputs and outputs."""
