"""A robot's twin: the robot in MuJoCo that carries the effects a diagnosis found."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.parquet import FORMAT
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import ActiveEffect, EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import TwinError, WrenchbedError
from wrenchbed.files import write_json
from wrenchbed.physics.taylor import Jet, Value
from wrenchbed.robots.base import Robot
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.mechanics import Mechanism


@dataclass(frozen=True, eq=False)
class Twin:
    """The robot in MuJoCo with effects.

    What moves or pulls is MuJoCo's physics on the robot's MJCF; what the sensor makes of its load
    is `effects`' own arithmetic. In motion, joints and springs stand where they would at rest
    under the weight they carry, and their displacement is differentiated in time.

    Attributes:
        model: robot and gravity.
        theta: parameters (P,) of ``model.parameters``: robot and sensor, without effects.
        active: effects with their values.
        recording: name of the recording that it is the twin of.
    """

    model: Model
    theta: np.ndarray
    active: tuple[ActiveEffect, ...] = ()
    recording: str | None = None

    @classmethod
    def read(cls, path: str | Path) -> "Twin":
        """Read and check ``twin.json``.

        Raises:
            TwinError: names the file and the field.
        """
        path = Path(path)
        if path.is_dir():
            raise TwinError(f"{path}: is a folder; give its twin.json")
        try:
            raw = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise TwinError(f"{path}: there is no such file") from error
        except (ValueError, OSError) as error:
            raise TwinError(f"{path}: not valid JSON: {error}") from error
        return cls.from_json(raw, str(path))

    @classmethod
    def from_json(cls, raw: Any, where: str = "twin") -> "Twin":
        """From the contract's JSON object.

        Raises:
            TwinError: names the field, what was found and what is allowed.
        """
        known = {"format", "robot", "gravity", "theta", "tool", "effects", "recording"}
        part = _Part(where, "", raw, known)
        if part.raw.get("format") != FORMAT:
            raise part.error("format", f"must be {FORMAT}")
        with part.naming("robot"):
            robot = registry.load("robots", str(part.raw.get("robot")))
        model = Model(robot, part.gravity(robot))
        with part.naming("theta"):
            theta = model.parameters.vector(part.inside("theta", None).raw)
        active = []
        listed = part.raw.get("effects", [])
        if not isinstance(listed, list):
            raise part.error("effects", "must be a list")
        for k, item in enumerate(listed):
            one = _Part(where, f"effects[{k}]", item, {"effect", "parameters"})
            with one.naming("effect"):
                given = one.inside("parameters", None).raw
                active.append(ActiveEffect.of(robot, str(one.raw.get("effect")), given))
        recording = part.raw.get("recording")
        if not isinstance(recording, str | None):
            raise part.error("recording", "must be a name")
        twin = cls(model, theta, tuple(active), recording)
        part.check_tool(twin.tool())
        return twin

    def to_json(self) -> dict[str, Any]:
        """The contract's JSON object; ``tool`` says again what ``theta`` holds."""
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
        }

    def write(self, path: str | Path) -> None:
        """Write ``twin.json``."""
        write_json(path, self.to_json())

    def tool(self) -> dict[str, Any]:
        """Mass [kg] and CoG (3,) [m] in sensor axes, without effects."""
        tool = self.model.robot.tool(self.own)
        return {"mass": float(tool.mass), "cog": [float(c) for c in tool.cog]}

    def wrench(self, scene: Scene) -> np.ndarray:
        """Readings (M, 6) [N, N·m] of every row, at rest or in motion; without random parts.

        Raises:
            TwinError: the scene is of another robot.
        """
        if scene.robot is not self.model.robot:
            raise TwinError(
                f"a twin of {self.model.robot.name!r} cannot do what {scene.robot.name!r} did"
            )
        return self.reading(scene, self.load(scene))

    @cached_property
    def own(self) -> np.ndarray:
        """Parameters of the robot alone."""
        return self.theta[: len(self.model.robot.parameters)]

    @cached_property
    def mechanism(self) -> Mechanism:
        """The robot with the effects that MuJoCo carries, compiled."""
        robot = self.model.robot
        theta = EffectChain(self.active).theta(robot, self.own)
        return Mechanism(robot, theta, self.model.gravity, self.active)

    @cached_property
    def _outside(self) -> EffectChain:
        """The effects that MuJoCo does not carry."""
        carried = self.mechanism.carried
        return EffectChain([a for a in self.active if a.effect.name not in carried])

    def load(self, scene: Scene, first: int = 0) -> np.ndarray:
        """What pulls on the sensor (M − first, 6) [N, N·m]; at rest, from row ``first`` on."""
        scene, mechanism = self._own_scene(scene), self.mechanism
        shift = self._outside.displacement(scene)
        q, coming = (scene.q + shift)[first:], scene.coming[first:]
        give: Value = mechanism.balance(q, coming)
        if scene.moving:
            jets = scene.in_motion(give)
            give = Jet(give, jets.d * mechanism.smooth, jets.dd * mechanism.smooth)
        load = mechanism.load(q, give, coming)
        padded = np.concatenate([np.zeros((first, 6)), load])
        pull = self._outside.pull(scene, Pose(*scene.pose), padded)
        return load + np.broadcast_to(pull, padded.shape)[first:]

    def reading(self, scene: Scene, load: np.ndarray) -> np.ndarray:
        """What the sensor shows (M, 6) [N, N·m] of a load (M, 6); without random parts."""
        shown = EffectChain(self.active).read(self._own_scene(scene), load)
        return self.model.read(shown, self.theta)

    def corrupt(self, rows: np.ndarray, t: np.ndarray, seed: int) -> np.ndarray:
        """The effects' random parts on rows (N, 6) at t (N,) [s], alike for a part of the rows."""
        for k, a in enumerate(self.active):
            rows = a.effect.corrupt(rows, t, a.values, np.random.default_rng([seed, 2, k]))
        return rows

    def _own_scene(self, scene: Scene) -> Scene:
        gravity = np.asarray(self.model.gravity)
        if scene.theta is self.own and np.array_equal(scene.gravity, gravity):
            return scene
        return replace(scene, theta=self.own, gravity=gravity)


def nominal(robot: Robot, active: Sequence[ActiveEffect] = ()) -> Twin:
    """The robot as designed, with effects."""
    model = Model.of(robot)
    return Twin(model, model.parameters.nominal, tuple(active))


class _Part:
    """A JSON object of a file, with errors that name file and field."""

    def __init__(self, where: str, field: str, raw: Any, known: set[str] | None) -> None:
        self.where, self.field = where, field
        if not isinstance(raw, Mapping):
            raise TwinError(f"{where}: {field or 'the file'} is not a JSON object")
        self.raw = raw
        for key in raw:
            if known is not None and key not in known:
                has = ", ".join(sorted(known))
                text = f"there is no field {self._name(key)}; {field or 'a twin'} has {has}"
                raise TwinError(f"{where}: {text}")

    def _name(self, key: str) -> str:
        return f"{self.field}.{key}" if self.field else key

    def error(self, key: str, rule: str) -> TwinError:
        """What stands in a field, and what is allowed there."""
        return TwinError(f"{self.where}: {self._name(key)} = {self.raw.get(key)!r} {rule}")

    @contextmanager
    def naming(self, key: str) -> Iterator[None]:
        """Errors inside name the field."""
        try:
            yield
        except TwinError:
            raise
        except WrenchbedError as error:
            raise TwinError(f"{self.where}: {self._name(key)}: {error}") from error

    def inside(self, key: str, known: set[str] | None) -> "_Part":
        """The object in a field; empty where it is absent."""
        return _Part(self.where, self._name(key), self.raw.get(key, {}), known)

    def gravity(self, robot: Robot) -> tuple[float, ...]:
        """(3,) [m/s²], the robot's own if absent."""
        found = self.raw.get("gravity", robot.gravity)
        if not isinstance(found, list | tuple) or len(found) != 3 or not all(map(_number, found)):
            raise self.error("gravity", "must be 3 numbers [m/s²]")
        return tuple(float(g) for g in found)

    def check_tool(self, told: Mapping[str, Any]) -> None:
        """Refuse a tool that is not the one of ``theta``."""
        tool = self.inside("tool", {"mass", "cog"})
        for key, value in tool.raw.items():
            try:
                same = np.allclose(np.asarray(value, dtype=float), told[key], rtol=1e-6, atol=1e-9)
            except (TypeError, ValueError):
                same = False
            if not same:
                raise tool.error(key, f"contradicts theta, by which it is {told[key]}: change that")


def _number(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and bool(np.isfinite(x))
