"""A robot in 3D on a page: ``assets/scene.js`` lets readers turn it, `Scene.svg` is a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from wrenchbed.errors import printable
from wrenchbed.pages.chart import Role, to_json

_LEAST = (0.89, 0.90, 0.91)
"""Colour of a part with probability 0 of a cause: light grey [RGB, 0 … 1]."""
_RAMP = np.array(
    [_LEAST, (0.99, 0.84, 0.42), (0.98, 0.62, 0.28), (0.86, 0.27, 0.26), (0.50, 0.04, 0.16)]
)
"""Light grey, yellow, orange, red, dark red [RGB, 0 … 1]: the darker the worse, also in print."""
_LIGHT = np.array([0.36, -0.48, 0.8])
"""Direction to the light of the still picture."""
_SHADOW = 0.55
"""Brightness of surfaces turned away from the light, relative to lit ones."""
_WIDTH, _HEIGHT, _EDGE, _HEAD = 520, 420, 24, 9
"""Size of the still picture, its margin and an arrow's head [px]."""
_VARIABLES = {"measured": "--real", "before": "--sim", "after": "--after", "box": "--box"}


def heat(share: np.ndarray | float) -> np.ndarray:
    """RGB colours (…, 3), 0 … 255, for probabilities (…,), 0 … 1, that a part is the cause."""
    at = np.clip(np.asarray(share, dtype=float), 0.0, 1.0) * (len(_RAMP) - 1)
    low = np.minimum(at.astype(int), len(_RAMP) - 2)
    part = (at - low)[..., None]
    mixed = _RAMP[low] * (1.0 - part) + _RAMP[low + 1] * part
    return np.rint(255.0 * mixed).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid part of the drawn robot, in one colour.

    Attributes:
        name: of the robot's part, such as a joint or the tool.
        body: index of the frame in `Scene.frames` that moves it.
        share: probability that the part is a cause of the gap, 0 … 1; decides its colour.
        places: corners of its surface in that frame (V, 3) [m].
        faces: triangles as indices of corners (T, 3), anticlockwise from outside.
    """

    name: str
    body: int
    share: float
    places: np.ndarray
    faces: np.ndarray


@dataclass(frozen=True, eq=False)
class Arrows:
    """Vectors (K, 3) at the sensor at K moments, sensor axes [m]; torques have two heads."""

    name: str
    role: Role
    vectors: np.ndarray
    heads: int = 1


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot at K moments, which a page shows in 3D.

    Attributes:
        name, title, caption, note, columns: as of a `Chart`.
        parts: rigid parts of the robot.
        frames: frames of B bodies in the world, last the sensor's (K, B, 3, 4): axes, origin [m].
        arrows: arrows that begin at the sensor.
        labels: a text for each moment.
        ids: number of the observation at each moment (K,); figures share their cursor by it.
        first: index of the moment that is shown first, and in the still picture.
        eye: direction (3,) from the robot to the viewer, world axes.
    """

    name: str
    title: str
    parts: Sequence[Part]
    frames: np.ndarray
    arrows: Sequence[Arrows]
    labels: Sequence[str]
    ids: np.ndarray
    first: int
    eye: np.ndarray
    caption: str = ""
    note: str = ""
    columns: int = 1

    def to_json(self) -> dict[str, Any]:
        """Convert to a JSON object, which the page's script draws and rotates."""
        return dict(to_json(self)) | {"ramp": [_colour(s) for s in np.linspace(0.0, 1.0, 5)]}

    @property
    def svg(self) -> str:
        """The first moment as one SVG element: parts from far to near, arrows, the colour bar."""
        look, frames = _looking(self.eye), self.frames[self.first]
        placed = [p.places @ frames[p.body, :, :3].T + frames[p.body, :, 3] for p in self.parts]
        surfaces = [x[p.faces] for x, p in zip(placed, self.parts, strict=True)]
        corners = np.concatenate(surfaces) @ look.T
        shares = np.repeat([p.share for p in self.parts], [len(p.faces) for p in self.parts])
        vectors = np.stack([np.zeros(3), *(a.vectors[self.first] for a in self.arrows)])
        tips = (vectors @ frames[-1, :, :3].T + frames[-1, :, 3]) @ look.T
        every = np.concatenate([corners.reshape(-1, 3), tips])[:, :2]
        low, high = every.min(axis=0), every.max(axis=0)
        size = np.array([_WIDTH, _HEIGHT], dtype=float)
        scale = float(((size - 2.0 * _EDGE) / (high - low)).min())
        flip = np.array([scale, -scale])
        middle = 0.5 * size - 0.5 * (low + high) * flip
        begin, *ends = tips[:, :2] * flip + middle
        inside = _surfaces(corners, shares, corners[..., :2] * flip + middle, look)
        for arrow, end in zip(self.arrows, ends, strict=True):
            inside += _arrow(begin, end, f"var({_VARIABLES[arrow.role]})")
        title, bar = escape(printable(self.title)), _bar(f"{self.name}-blame")
        start = f'<svg role="img" aria-label="{title}" viewBox="0 0 {_WIDTH} {_HEIGHT}">'
        return f"{start}<title>{title}</title>{''.join(inside)}{bar}</svg>"


def _colour(share: float, light: float = 1.0) -> str:
    """Colour ``#rrggbb`` for a probability of blame, 0 … 1, under a brightness ``light``, 0 … 1."""
    return "#" + "".join(f"{int(light * c):02x}" for c in heat(share))


def _looking(eye: np.ndarray) -> np.ndarray:
    """Rotation (3, 3), world to camera, of a camera that looks from direction eye (3,)."""
    back = eye / np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], back) / np.hypot(back[0], back[1])
    return np.stack([right, np.cross(back, right), back])


def _surfaces(
    corners: np.ndarray, shares: np.ndarray, paper: np.ndarray, look: np.ndarray
) -> list[str]:
    """SVG polygons of triangles (T, 3, 3) in camera axes, at ``paper`` (T, 3, 2) [px], that face
    the camera, far ones first; ``shares`` (T,): probability of blame, ``look``: rotation to the
    camera."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    bright = np.clip(normal @ look @ _LIGHT / length, 0.0, 1.0)
    faces = np.flatnonzero(normal[:, 2] > 1e-4 * length)
    polygons = ['<g fill="currentColor" stroke="currentColor" stroke-width="0.7">']
    for t in faces[np.argsort(corners[faces, :, 2].mean(axis=1), kind="stable")]:
        colour = _colour(float(shares[t]), _SHADOW + (1.0 - _SHADOW) * float(bright[t]))
        polygons.append(f'<polygon color="{colour}" points="{_points(paper[t])}"/>')
    return [*polygons, "</g>"]


def _points(places: np.ndarray) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def _arrow(begin: np.ndarray, end: np.ndarray, colour: str) -> list[str]:
    """SVG elements of an arrow between two points (2,) [px]; a short one is only its head."""
    length = float(np.linalg.norm(end - begin))
    along = (end - begin) / max(length, 1e-9)
    neck, side = end - min(_HEAD, length) * along, 0.5 * min(_HEAD, length) * along[::-1]
    head = _points(np.stack([end, neck + side * (1.0, -1.0), neck - side * (1.0, -1.0)]))
    line = f'<polyline points="{_points(np.stack([begin, neck]))}" stroke="{colour}"'
    return [f'{line} stroke-width="3"/>', f'<polygon points="{head}" fill="{colour}"/>']


def _bar(name: str) -> str:
    """SVG of the colour bar of a cause's probability; ``name`` makes its gradient's id unique."""
    stops = "".join(f'<stop offset="{s}" stop-color="{_colour(s)}"/>'
                    for s in np.linspace(0.0, 1.0, len(_RAMP)))  # fmt: skip
    y, text = _HEIGHT - 14, '<text font-size="11" style="fill: var(--ink)"'
    return (
        f'<linearGradient id="{name}">{stops}</linearGradient>'
        f'<rect x="24" y="{y}" width="150" height="9" fill="url(#{name})"/>'
        f'{text} x="12" y="{y + 9}">0</text>{text} x="180" y="{y + 9}">1: the cause is certain to '
        "be there</text>"
    )
