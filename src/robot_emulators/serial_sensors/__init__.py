"""The machinery of force/torque sensors on a serial line: a pseudo terminal, frames and faults.
Imports: emulators/base, errors. Sources: each sensor's file.
Read first: line.py, then sensor.py and one sensor. Emulators of a sensor alone are
emulators/robotiq_ft300.py and emulators/bota.py; the UR5's can have one of them on its flange.
"""
