"""Robots, one file or package each; `wrenchbed.registry.names("robots")` lists them."""
