"""The twin of a robot: the robot in MuJoCo with the effects that a diagnosis identified."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import ROBOT_MODEL, known_name, model_field
from wrenchbed.data.parquet import FORMAT
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import ActiveEffect, EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import TwinError
from wrenchbed.files import checked, write_json
from wrenchbed.physics.taylor_jets import Jet, Value, value
from wrenchbed.robots.base import Robot
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.added_compliance import Mechanism

_FIELDS = {"format", "robot", "gravity", "theta", "tool", "effects", "recording", ROBOT_MODEL}


@dataclass(frozen=True, eq=False)
class Twin:
    """A robot in MuJoCo with effects: imperfections such as backlash, compliance or sensor drift.

    Mechanical effects are MuJoCo's physics on the robot's MJCF; effects of the sensor are the
    arithmetic of `effects`. In motion, joints that effects add stand where they would at rest under
    the weight they carry, and their displacement is differentiated in time.

    Attributes:
        model: robot and gravity.
        theta: parameters (P,) of ``model.parameters``: robot and sensor, without effects.
        active: effects with their values.
        recording: name of the recording that was diagnosed.
    """

    model: Model
    theta: np.ndarray
    active: tuple[ActiveEffect, ...] = ()
    recording: str | None = None

    @classmethod
    def read(cls, path: str | Path) -> "Twin":
        """Read and check ``twin.json``; a `TwinError` names the file and the field."""
        return cls.from_json(checked.load(path, TwinError), str(path))

    @classmethod
    def from_json(cls, raw: Any, where: str = "twin") -> "Twin":
        """Twin from an object ``raw`` of twin.json; a `TwinError` names ``where``, field,
        remedy."""
        fields = checked.Fields(raw, f"{where}: ", TwinError).only(_FIELDS, "a twin")
        if fields.raw.get("format") != FORMAT:
            raise fields.error("format", f"must be {FORMAT}")
        with fields.naming("robot"):
            name = known_name(fields.raw, str(fields.raw.get("robot")))
            robot = registry.load("robots", name)
        gravity = fields.numbers("gravity", 3, rule="must be 3 numbers [m/s²]")
        model = Model(robot, gravity or tuple(robot.gravity))
        with fields.naming("theta"):
            theta = model.parameters.vector(fields.part("theta").raw)
        active = []
        for entry in fields.parts("effects"):
            entry.only({"effect", "parameters"}, entry.name)
            with entry.naming("effect"):
                name, values = str(entry.raw.get("effect")), entry.part("parameters").raw
                active.append(ActiveEffect.of(robot, name, values))
        twin = cls(model, theta, tuple(active), fields.text("recording"))
        twin._check_tool(fields.part("tool"))
        return twin

    def _check_tool(self, tool: checked.Fields) -> None:
        """Raise a `TwinError` if the ``tool`` of a twin.json contradicts ``theta``."""
        expected = self.tool()
        for key, given in tool.only(expected, "tool").raw.items():
            try:
                same = np.allclose(np.asarray(given, float), expected[key], rtol=1e-6, atol=1e-9)
            except (TypeError, ValueError, OverflowError):
                same = False
            if not same:
                rule = f"contradicts theta, by which it is {expected[key]}: change that"
                raise tool.error(key, rule)

    def to_json(self) -> dict[str, Any]:
        """JSON object in the format of twin.json; ``tool`` repeats what ``theta`` holds."""
        known = self.model.parameters
        values = known.mapping(self.theta)
        return {
            "format": FORMAT,
            "robot": self.model.robot.name,
            "gravity": list(self.model.gravity),
            "theta": {p.name: values[p.name] for p in known if values[p.name] != p.nominal},
            "tool": self.tool(),
            "effects": [
                {"effect": a.effect.name, "parameters": dict(a.values)} for a in self.active
            ],
            "recording": self.recording,
            **model_field(self.model.robot.name),
        }

    def write(self, path: str | Path) -> None:
        """Write ``twin.json``."""
        write_json(path, self.to_json())

    def tool(self) -> dict[str, Any]:
        """Mass [kg] and CoG (3,) [m] of the tool, sensor axes, as twin.json states them."""
        tool = self.model.robot.tool(self.robot_theta)
        return {"mass": float(tool.mass), "cog": [float(c) for c in tool.cog]}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Readings (M, 6) [N, N·m] of every row, at rest or in motion, without random parts; a
        `TwinError` if the scene is of another robot."""
        if scene.robot is not self.model.robot:
            raise TwinError(
                f"a twin of {self.model.robot.name!r} cannot do what {scene.robot.name!r} did"
            )
        return self.reading(scene, self.load(scene))

    def scene(
        self, q: Value, t: np.ndarray, held: np.ndarray | None = None,
        warmth: np.ndarray | None = None,
    ) -> Scene:  # fmt: skip
        """Make the input of effects from joint values (N, J), a `Jet` in motion, at times (N,) [s];
        ``held`` (N,), boolean: rows that are measured, all if None; ``warmth`` (N,): rise of
        temperature [K]."""
        held = np.ones(len(t), dtype=bool) if held is None else held
        gravity = np.asarray(self.model.gravity)
        return Scene(self.model.robot, self.robot_theta, gravity, q, t, held, warmth)

    @cached_property
    def robot_theta(self) -> np.ndarray:
        """Parameters of the robot alone: the first ones of ``theta`` (P,), without the sensor's."""
        return self.model.robot.robot_theta(self.theta)

    @cached_property
    def mechanism(self) -> Mechanism:
        """The twin's robot, compiled with the effects that MuJoCo carries."""
        robot = self.model.robot
        theta = EffectChain(self.active).theta(robot, self.robot_theta)
        return Mechanism(robot, theta, self.model.gravity, self.active)

    @cached_property
    def _outside(self) -> EffectChain:
        """The twin's effects that MuJoCo cannot simulate, as a chain of formulas."""
        carried = self.mechanism.carried
        return EffectChain([a for a in self.active if a.effect.name not in carried])

    def load(self, scene: Scene, first: int = 0) -> np.ndarray:
        """Load on the sensor (M − first, 6) [N, N·m]: at rest without the rows before ``first``."""
        scene, mechanism = self._own_scene(scene), self.mechanism
        shift = self._outside.displacement(scene)
        q, coming = (scene.q + shift)[first:], scene.coming[first:]
        give: Value = mechanism.balance(q, coming)
        if scene.moving:
            jets = scene.in_motion(give)
            give = Jet(give, jets.d * mechanism.smooth, jets.dd * mechanism.smooth)
        load = mechanism.load(q, give)
        padded = np.concatenate([np.zeros((first, 6)), load])
        pull = self._outside.pull(scene, Pose(*scene.pose), padded)
        return load + np.broadcast_to(pull, padded.shape)[first:]

    def place(self, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Orientation (M, 3, 3) and position (M, 3) [m] of the sensor in the world, at rest."""
        scene = self._own_scene(scene)
        q = value(scene.q) + value(self._outside.displacement(scene))
        return self.mechanism.place(q, self.mechanism.balance(q, scene.coming))

    def reading(self, scene: Scene, load: np.ndarray) -> np.ndarray:
        """Sensor reading (M, 6) [N, N·m] of a load (M, 6), without random parts."""
        shown = EffectChain(self.active).read(self._own_scene(scene), load)
        return self.model.read(shown, self.theta)

    def corrupt(self, rows: np.ndarray, t: np.ndarray, seed: int) -> np.ndarray:
        """Add the effects' random parts to rows (N, 6) at t (N,) [s]; those of a row depend on the
        seed and earlier rows alone."""
        for k, a in enumerate(self.active):
            rows = a.effect.corrupt(rows, t, a.values, np.random.default_rng([seed, 2, k]))
        return rows

    def _own_scene(self, scene: Scene) -> Scene:
        gravity = np.asarray(self.model.gravity)
        if scene.theta is self.robot_theta and np.array_equal(scene.gravity, gravity):
            return scene
        return replace(scene, theta=self.robot_theta, gravity=gravity)


def nominal(robot: Robot, active: Sequence[ActiveEffect] = ()) -> Twin:
    """Twin of the robot with nominal parameters and with the effects ``active``."""
    model = Model.of(robot)
    return Twin(model, model.parameters.nominal, tuple(active))
