"""MedRUE behind a CAN bus: six CiA 402 drives and an ATI Mini40 on its NETCANOEM board.
Free: the inside (tests/emulators/test_medrue_drive.py). Others rely on: names of settings and
faults (docs/how-to/hardware.md), cia402.eds. Never: a codec of wrenchbed's driver; both sides are
written from the standards. Read first: server.py, then drive.py."""
