"""wrenchbed."""
