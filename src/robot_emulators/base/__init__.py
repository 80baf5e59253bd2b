"""What every emulator shares: life cycle, event loop, real time, settings, faults.
Imports: plant, errors.
Read first: emulator.py, then event_loop.py.
"""
