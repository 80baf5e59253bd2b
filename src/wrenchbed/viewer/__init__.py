"""Recordings, plans and diagnoses as pictures for rerun; the only room that knows rerun.
May import: reports, diagnosis, campaigns (recording), twin, simulation and the rooms below them.
Never: numbers of its own; it draws what recordings, plans and answers hold.
Read first: `show`, then `recordings`; `stream` is the canvas that everything is drawn on.
Used by: cli.
"""

from wrenchbed import registry

registry.require("rerun", "view")  # named by its extra where it is missing
