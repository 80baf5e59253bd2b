"""Diagnosis of the gap between a simulator and a recording: where, which effect, how far."""
