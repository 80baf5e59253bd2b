"""Rotations, wrenches, gravity of an arm, sensor noise, parameters, Taylor arithmetic in time.
Read first: `wrench` (sign and axes), then `model_parameters` and `taylor_jets`.
Free: the inside of each file (how it is evaluated); tests/physics, tests/robots hold it to MuJoCo.
Others rely on: signs, axes, names of channels: public (docs/contracts.md); order of the inertial
parameters: change exports and fits with it; noise of a seed: `scripts/studies` prints its numbers.
Never: MuJoCo, files, names of robots."""
