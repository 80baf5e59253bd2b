"""A CANopen slave without a profile: object dictionary, SDO server, PDOs, NMT, errors, EDS file.
Free: the inside (tests/emulators/test_can_parts.py). Others rely on: hooks ``on_*`` and objects of
`Node` (medrue/drive.py). Never: a profile (CiA 402) or a device; those build on this folder.
Read first: node.py, then dictionary.py."""
