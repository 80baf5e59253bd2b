"""An arm as numbers: geometry, inertia and loops from a user's model file, from base to sensor.

Links are numbered along the chain, those of an arm with closed loops in MuJoCo's order. A link's
frame has the axes of the file's body and its origin at the joint; ``turn`` and ``shift`` lead from
the link before (from the base, of the first) to it at joint value 0. It goes into recordings as
JSON, so that they can be read without the file.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, TypeVar

import numpy as np

HINGE, SLIDE = "hinge", "slide"
_Made = TypeVar("_Made", "ArmModel", "ArmLink", "Load", "Closure", "Shape")
_TREE = ("parents", "end", "driven", "closures")
"""Fields of `ArmModel` that form the entry ``loops`` in JSON, which is null for a serial chain."""
MESH_VERTICES = 300
"""About the most vertices that a mesh keeps: enough to know a link by, few enough to travel."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A drawn geom in the frame of its link: MuJoCo's kind (box, sphere, capsule, cylinder,
    ellipsoid, plane or mesh), sizes (3,) [m], position (3,) [m], quaternion w x y z, colour 0 … 1,
    and of a mesh vertices (V, 3) [m] and faces (F, 3)."""

    kind: str
    size: tuple[float, ...]
    pos: tuple[float, ...]
    quat: tuple[float, ...]
    rgba: tuple[float, ...]
    vertices: tuple[tuple[float, ...], ...] = ()
    faces: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class ArmLink:
    """A joint of an arm and the link that it moves.

    Attributes:
        joint, body: their names in the user's file.
        kind: hinge or slide.
        axis: unit vector (3,) in the link's axes.
        turn, shift: rotation (3, 3) and origin (3,) [m] in the frame of the link before.
        lower, upper, speed, home: limits, top speed and home [rad or m; speed per s].
        mass, cog, inertia: of all that moves with it [kg], (3,) [m], (3, 3) [kg·m²] about the CoG.
        shapes: its geoms for drawing.
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
    """Load behind the sensor, in sensor axes: mass [kg], CoG (3,) [m], inertia (6,) [kg·m²] about
    the CoG, xx yy zz xy xz yz; the names of its bodies and its shapes."""

    mass: float
    cog: tuple[float, ...]
    inertia: tuple[float, ...]
    bodies: tuple[str, ...] = ()
    shapes: tuple[Shape, ...] = ()


@dataclass(frozen=True, eq=False)
class Closure:
    """Constraint that closes a loop: MuJoCo's ``connect``, which joins points of two links.

    Attributes:
        name: the file's, or ``loop1`` …
        first, second: numbers of the links; −1 is the base.
        places: the point in the axes of either link (2, 3) [m].
    """

    name: str
    first: int
    second: int
    places: np.ndarray


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Geometry and inertia of an arm from base to sensor, as read from a user's model file.

    Attributes:
        name: name of the model in its file.
        base_turn, base_shift: rotation (3, 3) and origin (3,) [m] of the base in the world.
        base_shapes: what stands around the first joint, in base axes.
        links: along the chain.
        end_turn, end_shift: rotation (3, 3) and origin (3,) [m] of the sensor in the last link.
        load: behind the sensor, as the file has it; None where that weighs nothing.
        gravity: gravity in world axes (3,) [m/s²].
        parents: number of the link before each link; −1 is the base.
        end: number of the link that carries the sensor.
        driven: links whose joints have actuators, q1 … in this order; all others are passive.
        closures: constraints that close loops; empty of a serial chain.
        floor: lowest height that moving parts may have [m], None without a floor.
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
    parents: tuple[int, ...]
    end: int
    driven: tuple[int, ...]
    closures: tuple[Closure, ...] = ()
    floor: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Convert this arm to a JSON object, which `from_json` reads."""

        def plain(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
            return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in pairs}

        raw = asdict(self, dict_factory=plain)
        loops = {key: raw.pop(key) for key in _TREE}
        return raw | {"loops": loops if self.closures else None}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "ArmModel":
        """Make an arm from the JSON object of `to_json`."""
        load, count = raw["load"], len(raw["links"])
        chain = {"parents": [*range(-1, count - 1)], "end": count - 1, "driven": [*range(count)]}
        rest = {key: value for key, value in raw.items() if key != "loops"}
        tree: Any = raw.get("loops") or chain | {"closures": []}
        return _made(
            cls, rest | tree, load=None if load is None else _made(Load, load),
            base_shapes=tuple(_made(Shape, shape) for shape in raw["base_shapes"]),
            links=tuple(_made(ArmLink, link) for link in raw["links"]),
            closures=tuple(_connect(closure) for closure in tree["closures"]),
        )  # fmt: skip

    @property
    def reach(self) -> float:
        """Length of the stretched arm [m]; with closed loops, of its longest branch at home."""
        far = [0.0]
        for link, before in zip(self.links, self.parents, strict=True):
            length = float(np.linalg.norm(link.shift)) if before >= 0 else 0.0
            slid = abs(link.home) if self.closures and link.kind == SLIDE else 0.0
            far.append(far[before + 1] + length + slid)
        return max(far) + float(np.linalg.norm(self.end_shift))

    @property
    def moved(self) -> tuple[ArmLink, ...]:
        """Links whose joints are driven, in the order q1 … of these joints."""
        return tuple(self.links[k] for k in self.driven)

    @property
    def columns(self) -> tuple[str, ...]:
        """Name of each link's joint in the robot's own MJCF: q1 … if driven, else the file's."""
        driven = {k: f"q{n}" for n, k in enumerate(self.driven, start=1)}
        return tuple(driven.get(k, f"passive_{x.joint}") for k, x in enumerate(self.links))


def _made(kind: type[_Made], raw: Mapping[str, Any], **parts: Any) -> _Made:
    """Make a dataclass ``kind`` from its fields in JSON, ``raw``, or for some from ``parts``."""
    arrays = {f.name for f in fields(kind) if f.type is np.ndarray}
    values: dict[str, Any] = {
        k: np.array(v, dtype=float) if k in arrays else _tuples(v) for k, v in raw.items()
    }
    if "shapes" in raw:
        parts["shapes"] = tuple(_made(Shape, shape) for shape in raw["shapes"])
    return kind(**(values | parts))


def _connect(raw: Mapping[str, Any]) -> Closure:
    """Make a `Closure` from JSON; a `ValueError` for kinds that only old recordings state."""
    if raw.get("kind", "connect") != "connect":
        raise ValueError(f"{raw['name']} is a {raw['kind']}: only a connect closes a loop")
    return _made(Closure, {f.name: raw[f.name] for f in fields(Closure)})


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) by an angle [rad] about a unit axis (3,)."""
    from scipy.spatial.transform import Rotation  # slow to load: only when it is used

    return np.asarray(Rotation.from_rotvec(angle * np.asarray(axis)).as_matrix())


def lighter(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Simplify a mesh (V, 3), (F, 3) to about `MESH_VERTICES` vertices, and return it.

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
