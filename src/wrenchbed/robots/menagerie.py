"""Model files of known robots by name: MuJoCo Menagerie's, which its package downloads and keeps.

https://github.com/google-deepmind/mujoco_menagerie; each model has a licence of its own.
"""

from pathlib import Path

from wrenchbed import registry
from wrenchbed.errors import MissingExtraError, NotFoundError, did_you_mean

EXTRA = "menagerie"
"""Extra that installs the package ``mujoco-menagerie``."""


def model_of(name: str) -> Path:
    """Path of the MJCF of a robot by its name in MuJoCo Menagerie, downloaded on first use. Raises
    a `MissingExtraError` if the package is not installed, a `NotFoundError` if there is no such
    robot, or it cannot be downloaded."""
    try:
        menagerie = registry.require("mujoco_menagerie", EXTRA)
    except MissingExtraError as error:
        raise MissingExtraError(
            f"{name} is no file, and a robot by name asks for more: {error}"
        ) from None
    try:
        robot = menagerie.get(name)
        return Path(robot.xml(robot.default_model))
    except menagerie.UnknownRobotError:
        hint = did_you_mean(name, menagerie.names()) or "."
        raise NotFoundError(
            f"{name} is neither a file nor a robot of MuJoCo Menagerie{hint} "
            "`mujoco-menagerie names` lists them"
        ) from None
    except menagerie.MenagerieError as error:
        raise NotFoundError(
            f"{name} is not downloaded yet, and cannot be: {error}. Is there a network? What was "
            "downloaded once needs none"
        ) from error
