"""A CANopen slave without a profile: object dictionary, SDO server, PDOs, NMT, errors, EDS file.
Imports: emulators/can_bus.
Never: a profile (CiA 402) or a device; those build on this folder.
Read first: node.py, then dictionary.py.
"""
