"""A CANopen slave without a profile: object dictionary, SDO server, PDOs, NMT, errors, EDS file.
Imports: emulators/can_bus.
Read first: node.py, then dictionary.py.
"""
