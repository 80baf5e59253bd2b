"""Rotations, wrenches, gravity of an arm, sensor noise, parameters, Taylor arithmetic in time.
Read first: `wrench` (sign and axes), then `model_parameters` and `taylor_jets`.
Free: the inside of each file (to rounding); tests/physics, tests/robots hold it to MuJoCo.
Others rely on: signs, axes, names of channels: public (docs/contracts.md); order of the inertial
parameters: change exports and fits with it; each value of a seed's noise, and the fields of
`NoiseModel` (sensor files): run `scripts/studies` (writes docs/studies).
Never: MuJoCo, files, names of robots."""
