"""A serial arm as numbers: what is left of a user's model file once base and sensor are named.

Links are numbered along the chain. A link's frame has the axes of the file's body and its origin at
the joint; ``turn`` and ``shift`` lead from the link before (from the base, of the first) to it at
joint value 0. It goes into recordings as JSON, so that they can be read without the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

HINGE, SLIDE = "hinge", "slide"


@dataclass(frozen=True, eq=False)
class Shape:
    """A geom to look at, in the frame of its link.

    Attributes:
        kind: MuJoCo's word: box, sphere, capsule, cylinder, ellipsoid, plane or mesh.
        size: MuJoCo's sizes (3,) [m].
        pos, quat: place (3,) [m] and turn w x y z.
        rgba: colour, 0 … 1.
        vertices, faces: of a mesh (V, 3) [m], (F, 3).
    """

    kind: str
    size: tuple[float, ...]
    pos: tuple[float, ...]
    quat: tuple[float, ...]
    rgba: tuple[float, ...]
    vertices: tuple[tuple[float, ...], ...] = ()
    faces: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class ArmLink:
    """One joint and what it moves.

    Attributes:
        joint, body: the file's names.
        kind: hinge or slide.
        axis: unit vector (3,) in the link's axes.
        turn: rotation (3, 3) from the link before; shift (3,) [m] in its axes.
        lower, upper, speed, home: limits, top speed and home [rad or m, 1/s].
        mass, cog, inertia: of all that moves with it [kg], (3,) [m], (3, 3) [kg·m²] about the CoG.
        shapes: what is drawn.
    """

    joint: str
    body: str
    kind: str
    axis: np.ndarray
    turn: np.ndarray
    shift: np.ndarray
    lower: float
    upper: float
    speed: float
    home: float
    mass: float
    cog: np.ndarray
    inertia: np.ndarray
    shapes: tuple[Shape, ...] = ()


@dataclass(frozen=True, eq=False)
class Load:
    """What hangs behind the sensor: mass [kg], CoG (3,) [m] and inertia (6,) [kg·m²] about it,
    xx yy zz xy xz yz, in sensor axes; the names of its bodies and what is drawn."""

    mass: float
    cog: tuple[float, ...]
    inertia: tuple[float, ...]
    bodies: tuple[str, ...] = ()
    shapes: tuple[Shape, ...] = ()


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A serial arm from base to sensor.

    Attributes:
        name: of the model in its file.
        base_turn, base_shift: the base in the world (3, 3), (3,) [m].
        base_shapes: what stands around the first joint, in base axes.
        links: along the chain.
        end_turn, end_shift: the sensor's frame in the last link's.
        load: behind the sensor, as the file has it; None where that weighs nothing.
        gravity: in world axes (3,) [m/s²].
        floor: lowest height of what moves [m], None without a floor.
    """

    name: str
    base_turn: np.ndarray
    base_shift: np.ndarray
    base_shapes: tuple[Shape, ...]
    links: tuple[ArmLink, ...]
    end_turn: np.ndarray
    end_shift: np.ndarray
    load: Load | None
    gravity: tuple[float, ...]
    floor: float | None = None

    def to_json(self) -> dict[str, Any]:
        """As JSON; `from_json` reads it."""
        return {name: _plain(value) for name, value in _items(self)}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "ArmModel":
        """From `to_json`."""
        parts = dict(raw)
        load = parts["load"]
        return cls(
            name=parts["name"],
            base_turn=np.array(parts["base_turn"]),
            base_shift=np.array(parts["base_shift"]),
            base_shapes=_shapes(parts["base_shapes"]),
            links=tuple(_link(link) for link in parts["links"]),
            end_turn=np.array(parts["end_turn"]),
            end_shift=np.array(parts["end_shift"]),
            load=None
            if load is None
            else Load(**{**_tuples(load), "shapes": _shapes(load["shapes"])}),
            gravity=tuple(parts["gravity"]),
            floor=parts["floor"],
        )

    def with_links(self, links: tuple[ArmLink, ...]) -> "ArmModel":
        """With other links."""
        return replace(self, links=links)

    @property
    def reach(self) -> float:
        """Length of the stretched arm [m]."""
        steps = [*(link.shift for link in self.links[1:]), self.end_shift]
        return float(sum(np.linalg.norm(step) for step in steps))


def _items(item: Any) -> list[tuple[str, Any]]:
    return [(f.name, getattr(item, f.name)) for f in fields(item)]


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Shape | ArmLink | Load):
        return {name: _plain(v) for name, v in _items(value)}
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return value


def _tuples(raw: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _deep(v) for k, v in raw.items()}


def _deep(value: Any) -> Any:
    return tuple(_deep(v) for v in value) if isinstance(value, list) else value


def _shapes(raw: list[dict[str, Any]]) -> tuple[Shape, ...]:
    return tuple(Shape(**_tuples(shape)) for shape in raw)


def _link(raw: Mapping[str, Any]) -> ArmLink:
    arrays = {k: np.array(raw[k], dtype=float) for k in ("axis", "turn", "shift", "cog", "inertia")}
    return ArmLink(**{**raw, **arrays, "shapes": _shapes(raw["shapes"])})


MESH_VERTICES = 300
"""About the most vertices that a mesh keeps: enough to know a link by, few enough to travel."""


def lighter(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A mesh (V, 3), (F, 3) with at most about `MESH_VERTICES` vertices, by joining near ones.

    Vertex clustering on a grid: Rossignac & Borrel 1993, doi 10.1007/978-3-642-78114-8_29.
    """
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    for cells in (48, 32, 24, 18, 14, 11, 9, 7, 6, 5, 4):
        cell = np.floor((vertices - low) / max(size, 1e-9) * cells).astype(int)
        _, group, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        if len(count) <= MESH_VERTICES:
            break
    joined = np.zeros((len(count), 3))
    np.add.at(joined, group.ravel(), vertices)
    kept = group.ravel()[faces]
    whole = (kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 0] != kept[:, 2])
    _, first = np.unique(np.sort(kept[whole], axis=1), axis=0, return_index=True)
    return joined / count[:, None], kept[whole][np.sort(first)]


@dataclass(frozen=True)
class ArmFile:
    """What was read from a model file.

    Attributes:
        arm: as numbers.
        held: joints off the chain, which stay at home.
        notes: what the user should know, one sentence each.
    """

    arm: ArmModel
    held: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())
