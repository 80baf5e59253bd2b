"""Rotations, wrenches, gravity of an arm, sensor noise, parameters, Taylor arithmetic in time.
Read first: `wrench` (sign and axes), then `parameters` and `time_derivatives`.
Free: the inside of each file (how a formula is evaluated); tests/physics and tests/robots compare
it with MuJoCo.
Others rely on: signs and axes, names of channels (docs/contracts.md), noise drawn from a seed.
Never: MuJoCo, files, names of robots."""
