"""Recordings, plans and diagnoses as pictures for rerun; the only room that knows rerun.
Free: the inside of each file (colours, layout, what is drawn); tests/viewer speak.
Others rely on: `show` and the views: change cli and scripts/screenshots with them. The room relies
on the rerun that pyproject.toml pins: run tests/viewer after a new pin.
Never: numbers of its own; this room draws what recordings, plans and answers hold.
Read first: `show`, then `recordings`; `rerun_canvas` is the canvas that everything is drawn on."""

from wrenchbed import registry

registry.require("rerun", "view")  # named by its extra where it is missing
