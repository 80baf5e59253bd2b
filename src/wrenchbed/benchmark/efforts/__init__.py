"""The referee of joint efforts: recordings of arms with sealed faults, made by a third physics.
Read first: `case`. Rigid bodies are MuJoCo's inverse dynamics of perturbed links; friction is LuGre
bristles; gears, cables, amplifiers and encoders follow laws other than the library's.
Free: laws of faults and noise; tests/benchmark/test_efforts_referee.py checks them.
Others rely on: names of draws (effects of drives, links …), their order (the cases of a seed).
Never: import drives, effects or the diagnosis; a test sees to it.
"""
