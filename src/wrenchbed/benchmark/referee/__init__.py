"""The referee: robots with sealed faults, made by physics that the library shares no code with.
Unlike the formulas of effects and look-alikes, a machine really moves here: hidden hinges deflect,
backlash has stops, hoses and pads push, by MuJoCo's forward dynamics with an implicit integrator at
1 ms (0.5 ms in motion); a sensor of other laws (Bouc–Wen, Dahl, chains of relaxations) reads it.
Read first: `case`, then `machine`. Free: code that draws nothing.
Others rely on: names of draws and signatures: change `fault.EFFECTS` with them. A change of laws,
sizes or order makes other cases of a seed: run tests/benchmark, make docs/sealed anew.
Never: import effects, look-alikes or the diagnosis; a test sees to it.
"""
