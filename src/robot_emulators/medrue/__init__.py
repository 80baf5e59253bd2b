"""MedRUE behind a CAN bus: six CiA 402 drives and an ATI Mini40 on its NETCANOEM board.
Imports: base, can_bus, canopen, plant, errors.
Never: a codec of wrenchbed's driver; both sides are written from the standards.
Read first: server.py, then drive.py.
"""
