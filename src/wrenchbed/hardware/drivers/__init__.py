"""Drivers, one file a device; `wrenchbed.registry.names("drivers")` lists them."""
