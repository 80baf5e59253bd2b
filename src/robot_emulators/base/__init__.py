"""What every emulator shares: life cycle, event loop, real time, settings, faults.
Free: inside (tests/emulators/test_emulator_contract.py). Others rely on: keys of fault scripts
(docs/how-to/hardware.md), `Options`, cycles that make up for missed deadlines. Never: import a
device; hold Python's lock in a cycle. Read first: emulator.py, then event_loop.py."""
