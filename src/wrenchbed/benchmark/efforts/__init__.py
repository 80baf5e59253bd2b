"""The referee of joint efforts: recordings of arms with sealed faults, made by a third physics.
Read first: `case`. Rigid bodies are MuJoCo's inverse dynamics of perturbed links; friction is LuGre
bristles; gears, cables, amplifiers and encoders follow laws other than the library's.
Free: code that draws nothing. After a change of laws, sizes or order (other cases of a seed) run
tests/benchmark/test_efforts_referee.py, make figures of docs/explanation/benchmark.md anew.
Others rely on: names of draws (effects of drives, links …): change them with the effect.
Never: import drives, effects or the diagnosis; a test sees to it.
"""
