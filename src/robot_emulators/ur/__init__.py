"""Universal Robots' arms with a CB3, e-Series or PolyScope X controller: RTDE, dashboard, scripts.
Imports: base, netft_box, plant, errors.
Never: a codec of wrenchbed's driver; both sides are written from the manuals.
Read first: server.py, then controller.py.
"""
