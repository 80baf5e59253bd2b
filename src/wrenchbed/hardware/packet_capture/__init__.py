"""Packets as they came over the wire: kept in files, read again, and played to drivers.
May import: errors.
Read first: capture.py, then playback.py.
"""
