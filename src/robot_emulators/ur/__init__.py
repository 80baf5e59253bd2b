"""Universal Robots' arms with a CB3, e-Series or PolyScope X controller: RTDE, dashboard, scripts.
Free: the code inside functions (tests/emulators/test_ur*.py). Not free: names of settings, faults
(change docs/how-to/hardware.md and scripts/reactions with them), ports, field names, URScript
functions and answers (as the manuals state), delays and limits of modes.py, motions.py, arm.py
(run scripts/reactions). Never: a codec of wrenchbed's driver; both are written from the manuals.
Read first: server.py, controller.py."""
