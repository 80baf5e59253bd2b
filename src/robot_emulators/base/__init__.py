"""What every emulator shares: life cycle, event loop, real time, settings, faults.
Imports: plant, errors.
Never: a device of another folder, or a client's library.
Read first: emulator.py, then event_loop.py.
"""
