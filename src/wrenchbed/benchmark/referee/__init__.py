"""The referee: robots with sealed faults, made by physics that the library shares no code with.

The diagnosis knows effects by closed forms at rigid poses; its look-alikes have formulas of their
own. Here a third machine really moves: hidden hinges deflect, backlash has stops, hoses and pads
push, all by MuJoCo's forward dynamics with an implicit integrator at 1 ms (0.5 ms in motion), then
a sensor of other laws (Bouc–Wen, Dahl, chains of relaxations) reads it. Nothing here may import
effects, look-alikes or the diagnosis; a test sees to it.
"""
