"""Robots, one file or package each; `wrenchbed.registry.names("robots")` lists them.

Free: the inside of a robot; tests/robots judge it.
Others rely on: names of parameters and joints (fit.json, twin.json, effects), nominal values in
models/ (a change is another `robot_digest` in a history), tolerances of parameters (priors of fits,
spread of simulated robots), the contract `base`, and that recordings carry described robots
(`described.rebuilt`, `ArmModel.to_json`: what an older version wrote must still load).
Never: a sensor's noise, an effect or a recording; MuJoCo only to write and read models.
Read first: `base` (what a robot is), then `chain` with `ur5` and `file_arm` as its kinds, and
`closed_loop` with `loop_arm`.
"""

SUPPORT = (
    "arm_model", "arm_spec", "arm_tree", "chain", "closed_loop", "compiled", "described",
    "file_arm", "inverse_dynamics", "loop_arm", "menagerie", "mjcf", "model_file", "model_source",
    "motion_limits", "serial_arm",
)  # fmt: skip
"""Modules of this package that are no plug-ins; `registry` skips them."""
