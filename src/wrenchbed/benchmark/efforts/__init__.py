"""The referee of joint efforts: recordings of arms with sealed faults, made by a third physics.

Rigid bodies are MuJoCo's inverse dynamics of perturbed true links; friction is LuGre bristles;
gears, cables, amplifiers and encoders follow laws other than the library's. Nothing here may import
drives, effects or the diagnosis; a test sees to it. Read first: `case`.
"""
