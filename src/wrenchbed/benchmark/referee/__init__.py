"""The referee: robots with sealed faults, made by physics that the library shares no code with.
Unlike the formulas of effects and look-alikes, a machine really moves here: hidden hinges deflect,
backlash has stops, hoses and pads push, by MuJoCo's forward dynamics with an implicit integrator at
1 ms (0.5 ms in motion); a sensor of other laws (Bouc–Wen, Dahl, chains of relaxations) reads it.
Read first: `case`, then `machine`.
Free: laws and sizes of faults, as long as tests/benchmark/test_referee.py and …_machine.py pass.
Others rely on: names of draws and of signatures (`fault.EFFECTS`); a seed makes the same cases.
Never: import effects, look-alikes or the diagnosis; a test sees to it.
"""
