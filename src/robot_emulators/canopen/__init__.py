"""A CANopen slave without a profile: object dictionary, SDO server, PDOs, NMT, errors, EDS file.
Free: the code inside functions (tests/emulators/test_can_parts.py). Not free: hooks ``on_*``,
`Node.fails` and `Objects` (change `medrue.cia402_node` and `cia402_axis` too); what CiA 301 states.
Never: a profile (CiA 402) or a device; those build on this folder. Read first: node.py."""
