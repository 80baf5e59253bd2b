"""A CANopen slave without a profile: object dictionary, SDO server, PDOs, NMT, errors, EDS file.
Free: the inside (tests/emulators/test_can_parts.py). Others rely on: hooks of `Node` (medrue).
Never: a profile (CiA 402) or a device; those build on this folder.
Read first: node.py, then dictionary.py.
"""
