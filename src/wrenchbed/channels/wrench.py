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
    """Forces and torques (M, 6) [N, N·m] in sensor axes: of the tool's load, cables and contacts.

    Of other channels the sensor's zero and mounting are fitted and never named as a cause
    (nuisance). Here zero and tool are stated and fitted; where they are wrong they are causes.
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
