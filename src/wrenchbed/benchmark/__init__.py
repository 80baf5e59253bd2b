"""Judges of the diagnosis: look-alike cases, the independent referee, sealed cases, scores."""
