"""Servers that speak the real robots' protocols, backed by MuJoCo; one folder a device."""
