"""What every emulator shares: life cycle, event loop, real time, settings, faults.
Free: the code inside functions (tests/emulators/test_emulator_contract.py). Not free: keys of fault
scripts and the words of ``--set`` (change docs/how-to/hardware.md too), fields of `Options` (filled
by wrenchbed/plant), how real_time.py makes up for missed deadlines (test_ur5_odd_clients.py;
scripts/reactions). Never: import a device; hold Python's lock in a cycle. Read first: emulator.py.
"""
