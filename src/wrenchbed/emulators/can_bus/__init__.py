"""A CAN bus between processes, with a model of the wire that the frames would travel on."""
