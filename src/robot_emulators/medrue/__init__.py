"""MedRUE behind a CAN bus: six CiA 402 drives and an ATI Mini40 on its NETCANOEM board.
Free: the code inside functions (tests/emulators/test_medrue_drive.py). Not free: names of settings
and faults (change docs/how-to/hardware.md too), cia402.eds (read by test_cia402_client.py), times,
windows and gains (tests/hardware/test_medrue_can.py and scripts/reactions judge how drives move and
stop). Never: a codec of wrenchbed's driver; both sides are written from the standards.
Read first: server.py, then drive.py."""
