"""MJCF and URDF of a user as XML: read within limits, before MuJoCo reads the file.

MuJoCo's reader looks at no signal, and its time grows with the square of the number of elements:
0.3 s for 2,000 bodies, 12 s for 10,000, minutes for 40,000 (MuJoCo 4.0). So the size of all files
that belong to a model, and the number of elements that it expands to, are bounded first.
"""

import stat
from dataclasses import dataclass
from math import prod
from pathlib import Path
from xml.etree import ElementTree

from wrenchbed.errors import NotFoundError, ParameterError

_MOST_BYTES = 2**24
"""Of a model's text with all that it includes: sixteen times that of the largest model of a robot
in example-robot-data, 1 MB."""
_MOST_ELEMENTS = 8_000
"""Of the expanded model: 4,000 bodies with a geom each, which MuJoCo reads in about 2 s; the files
of robots in `tests/data/robots` have 90 to 450."""
_NODE = 4
"""Elements that a node of a flexcomp or composite counts as: MuJoCo takes 43 s for 10,000 nodes,
as for the same number of bodies with geom, joint and site."""
_DEEPEST = 200
"""Levels of elements: MuJoCo descends by recursion; robots have 20 levels."""
_FOLDERS = ("assetdir", "meshdir")
_XACRO = "{http://www.ros.org/wiki/xacro}"


@dataclass(frozen=True)
class ModelSource:
    """A model file that was read as XML.

    Attributes:
        path: of the file.
        text: of the file.
        root: its root element, ``<mujoco>`` or ``<robot>``.
    """

    path: Path
    text: str
    root: ElementTree.Element

    @classmethod
    def of(cls, path: Path) -> "ModelSource":
        """Read a file.

        Raises:
            NotFoundError: there is no such file.
            ParameterError: it is no MJCF or URDF, or larger than any robot.
        """
        files = _Files(path)
        root = files.root(path)
        if root.tag not in ("mujoco", "robot"):
            raise ParameterError(
                f"{path}: is neither MJCF (<mujoco>) nor URDF (<robot>): begins with <{root.tag}>"
            )
        elements = files.elements(path)
        if elements > _MOST_ELEMENTS:
            raise ParameterError(
                f"{path}: expands to {elements:,} elements (with replicate, include, attach, "
                f"flexcomp), more than {_MOST_ELEMENTS:,}: leave out what is no part of the robot"
            )
        return cls(path, files.text(path), root)

    @property
    def urdf(self) -> bool:
        """Whether the source is URDF; otherwise it is MJCF."""
        return self.root.tag == "robot"

    def check_expanded(self) -> None:
        """Refuse unexpanded xacro.

        Raises:
            ParameterError: names the element and the command that expands it.
        """
        for element in self.root.iter():
            macro = str(element.tag).startswith(_XACRO)
            if macro or any("${" in v or "$(" in v for v in element.attrib.values()):
                tag = str(element.tag).replace(_XACRO, "xacro:")
                raise ParameterError(
                    f"{self.path}: holds unexpanded xacro (in <{tag}>): "
                    f"run  xacro {self.path.name} > robot.urdf  and state robot.urdf"
                )

    def speeds(self) -> dict[str, float]:
        """Top speed of each joint for which a URDF states one above 0, by name [rad/s, m/s]."""
        limits = {joint.get("name", ""): joint.find("limit") for joint in self.root.iter("joint")}
        stated = {n: float(x.get("velocity", 0.0)) for n, x in limits.items() if x is not None}
        return {name: speed for name, speed in stated.items() if speed > 0.0}

    def fixed_joints(self) -> dict[str, str]:
        """Child link of each fixed joint of a URDF."""
        children = {
            joint.get("name", ""): joint.find("child")
            for joint in self.root.findall("joint")
            if joint.get("type") == "fixed"
        }
        return {n: child.get("link", "") for n, child in children.items() if child is not None}

    def mimics(self) -> list[tuple[str, str]]:
        """Names of each joint of a URDF that mimics another one, and of that one."""
        return [
            (joint.get("name", ""), str(mimic.get("joint")))
            for joint in (self.root.findall("joint") if self.urdf else ())
            for mimic in joint.findall("mimic")
        ]


def content(path: Path, most: int = _MOST_BYTES) -> bytes:
    """Content of a regular file of a model.

    Raises:
        NotFoundError: there is no such file.
        ParameterError: a device, a pipe or a folder, or more than ``most`` bytes.
    """
    try:
        there = path.stat()
        if not stat.S_ISREG(there.st_mode):
            raise ParameterError(f"{path}: is no regular file: give an MJCF or URDF file")
        if there.st_size <= most:
            return path.read_bytes()
    except OSError as cause:
        raise NotFoundError(f"{path}: {cause.strerror or cause}") from None
    raise ParameterError(
        f"{path}: has {there.st_size:,} bytes, with other files of the model more than "
        f"{_MOST_BYTES:,}: give a file of the robot alone"
    )


class _Files:
    """Text files that belong to one model, each read once."""

    def __init__(self, main: Path) -> None:
        self._folder, self._remaining = main.parent, _MOST_BYTES
        self._texts: dict[Path, str] = {}
        self._roots: dict[Path, ElementTree.Element] = {}
        self._counts: dict[Path, int] = {}
        self._models: dict[Path, dict[str, str]] = {}
        self._folders: dict[Path, list[str]] = {}
        self._open: list[Path] = []

    def text(self, path: Path) -> str:
        """Text of a file."""
        return self._texts[path.resolve()]

    def root(self, path: Path) -> ElementTree.Element:
        """Root element of a file."""
        place = path.resolve()
        if place in self._roots:
            return self._roots[place]
        raw = content(path, self._remaining)
        self._remaining -= len(raw)
        try:
            text = raw.decode()
        except UnicodeDecodeError:
            raise ParameterError(f"{path}: is no text: state an MJCF or URDF file") from None
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ParameterError(f"{path}: defines entities: leave them out, no robot needs them")
        try:
            self._roots[place] = ElementTree.fromstring(text)
        except ElementTree.ParseError as cause:
            raise ParameterError(f"{path}: is no MJCF or URDF: not XML ({cause})") from None
        self._texts[place] = text
        return self._roots[place]

    def elements(self, path: Path, level: int = 0) -> int:
        """Number of elements that a file expands to."""
        place = path.resolve()
        if place in self._open:
            raise ParameterError(f"{path}: includes or attaches itself: leave that out")
        if place not in self._counts:
            self._open.append(place)
            self._counts[place] = self._below(self.root(path), path, level)
            self._open.pop()
        return self._counts[place]

    def _below(self, element: ElementTree.Element, path: Path, level: int) -> int:
        """Number of elements that an element of a file expands to, itself included."""
        if level > _DEEPEST:
            raise ParameterError(
                f"{path}: nested more than {_DEEPEST} levels deep: give a flat one"
            )
        name = element.get("file", "")
        if element.tag == "attach":
            name = self._attached(element.get("model", ""), path)
        total = 1
        if element.tag in ("include", "attach") and (file := self._found(name, path)):
            total += self.elements(file, level + 1)
        if element.tag == "flexcomp" and (file := self._found(name, path)):
            total += len(content(file, self._remaining)) // 100  # a line of a node or face
        for inner in element:
            total += self._below(inner, path, level + 1)
        copies = prod(_whole(word) for word in element.get("count", "").split())
        if element.tag == "replicate":
            return total * copies
        return total + _NODE * copies if element.tag in ("flexcomp", "composite") else total

    def _attached(self, model: str, path: Path) -> str:
        """Path of a model as a file states it in its assets; empty if it does not."""
        if path not in self._models:
            assets = self.root(path).iter("model")
            self._models[path] = {x.get("name", ""): x.get("file", "") for x in assets}
        return self._models[path].get(model, "")

    def _found(self, name: str, path: Path) -> Path | None:
        """A file beside the one that names it or the main one, or in its folder of meshes; None if
        there is none."""
        if not name:
            return None
        if path not in self._folders:
            compilers = self.root(path).findall("compiler")
            self._folders[path] = ["", *(c.get(d, "") for c in compilers for d in _FOLDERS)]
        places = [
            folder / d / name for folder in (path.parent, self._folder) for d in self._folders[path]
        ]
        return next((p for p in places if p.exists()), None)


def _whole(word: str) -> int:
    """A whole number; 1 of what is none, which MuJoCo refuses."""
    return max(int(word[:18]), 1) if word.isascii() and word.isdigit() else 1
