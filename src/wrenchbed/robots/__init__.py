"""Robots, one file or package each; `wrenchbed.registry.names("robots")` lists them.

Free: the inside of functions; tests/robots judge it. Tolerances, limits, tuned constants are not:
they are priors of fits and spreads of simulated robots (sealed cases, `scripts/learn_reliability`).
Others rely on: names of parameters and joints (fit.json, twin.json, effects: docs/contracts.md),
nominal values in models/ (a change is another robot in a user's history), the contract `base`,
described robots in recordings (`described.rebuilt`, `ArmModel.to_json`: old ones must load).
Never: a sensor's noise, an effect or a recording; MuJoCo only to write and read models.
Read first: `base` (what a robot is), then `chain` with `ur5` and `file_arm` as its kinds, and
`closed_loop` with `loop_arm`.
"""

SUPPORT = (
    "arm_numbers", "arm_mjcf", "arm_from_mujoco", "chain", "closed_loop", "compiled", "described",
    "file_arm", "inverse_dynamics", "loop_arm", "menagerie", "mjspec_edits", "model_file",
    "checked_moves", "serial_arm", "user_model_xml",
)  # fmt: skip
"""Modules of this package that are no plug-ins; `registry` skips them."""
