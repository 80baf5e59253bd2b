"""Universal Robots' arms with a CB3, e-Series or PolyScope X controller: RTDE, dashboard, scripts.
Free: the inside (tests/emulators/test_ur*.py). Others rely on: names of settings and faults (docs/
how-to/hardware.md, scripts/reactions), fields and answers as manuals state them. Never: a codec of
wrenchbed's driver; both are written from the manuals. Read first: server.py, controller.py."""
