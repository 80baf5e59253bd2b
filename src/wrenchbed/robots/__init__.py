"""Robots, one file or package each; `wrenchbed.registry.names("robots")` lists them.
Imports physics, files and registry.
Never: a sensor's noise, an effect or a recording; MuJoCo only to write and read models.
Read first: `base` (what a robot is), then `chain` with `ur5` and `file_arm` as its kinds, and
`closed_loop` with `loop_arm`.
Used by: every other room but files, jobs, pages, physics and sensors.
"""

SUPPORT = (
    "arm_model", "arm_spec", "arm_tree", "chain", "closed_loop", "compiled", "described",
    "file_arm", "inverse_dynamics", "loop_arm", "menagerie", "mjcf", "model_file", "model_source",
    "motion_limits", "serial_arm",
)  # fmt: skip
"""Modules of this package that are no plug-ins."""
