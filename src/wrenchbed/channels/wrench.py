"""The wrench on the sensor: forces and torques, at rest and in motion."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from wrenchbed.channels.base import PLACING, Channel
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.wrench import CHANNELS, UNITS


class Wrench(Channel):
    """Wrench of the tool and of whatever else pulls, as the sensor reads it.

    Its zero and the tool are no nuisance: they are stated and fitted, and causes where wrong.
    """

    name = "wrench"
    title = "forces and torques on the sensor"
    columns: ClassVar[Mapping[str, str]] = dict(zip(CHANNELS, UNITS, strict=True))
    usual = "bias, tool mass and centre of gravity"
    stages = PLACING | {"load", "reading", "timing"}
    modes = ("static", "dynamic")
    weighs = True

    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        return chain.read(scene, load + chain.pull(scene, pose, load))


CHANNEL = Wrench()
