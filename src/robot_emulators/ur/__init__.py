"""Universal Robots' arms with a CB3, e-Series or PolyScope X controller: RTDE, dashboard, scripts.
Imports: base, netft_box, plant, errors.
Read first: server.py, then controller.py.
"""
