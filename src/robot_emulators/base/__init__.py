"""What every emulator shares: life cycle, event loop, real time, settings, faults.
Free: the inside (tests/emulators/test_emulator_contract.py). Others rely on: scripts of faults,
``--set``, `Options`. Never: a device of another folder, or a client's library.
Read first: emulator.py, then event_loop.py.
"""
