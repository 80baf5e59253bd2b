"""Gymnasium environments of calibration and contact; importing this room registers them.
Free: the inside of each file (rendering); tests/environments/test_environments.py speaks.
Others rely on: ids, observations, actions, rewards: a change makes learnt agents useless, so give a
new version (``-v1``); docs/how-to/environments.md states them and the policies: change it, too.
Never: import this room from another one, so that gymnasium stays optional.
Read first: `calibration`, then `contact`."""

import os
import sys

import gymnasium

_LONGEST = {"Calibration": 400, "Contact": 500}
"""Most steps of an episode: a bound for budgets that run out earlier."""


def register() -> None:
    """Make the environments ``wrenchbed/…`` known to `gymnasium.make`; safe to call again."""
    for robot, title in (("ur5", "UR5"), ("medrue", "MedRUE")):
        for kind, steps in _LONGEST.items():
            name = f"wrenchbed/{title}{kind}-v0"
            if name not in gymnasium.registry:
                gymnasium.register(
                    name,
                    entry_point=f"wrenchbed.environments.{kind.lower()}:{kind}Env",
                    kwargs={"robot": robot},
                    max_episode_steps=steps,
                )


if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")  # pictures without a screen; mujoco reads it once
register()
