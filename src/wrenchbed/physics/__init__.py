"""Rotations, wrenches, gravity of an arm, sensor noise, parameters, Taylor arithmetic in time.
Read first: `wrench` (sign and axes), then `parameters` and `time_derivatives`.
Free: the inside of each file (how it is evaluated); tests/physics, tests/robots hold it to MuJoCo.
Others rely on: signs and axes, names of channels (docs/contracts.md), order of inertial parameters
(exports, fits), noise drawn from a seed (simulated recordings).
Never: MuJoCo, files, names of robots."""
