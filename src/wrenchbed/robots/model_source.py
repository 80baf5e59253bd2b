"""MJCF and URDF of a user as XML: read within limits, before MuJoCo reads the file.

MuJoCo's reader looks at no signal, and its time grows with the square of the number of elements:
0.3 s for 2,000 bodies, 12 s for 10,000, minutes for 40,000 (MuJoCo 4.0). So the size of all files
that belong to a model, and the number of elements that it expands to, are bounded first.
"""

import math
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from wrenchbed.errors import NotFoundError, ParameterError

_MOST_BYTES = 2**24
"""Largest size of a model's text with all that it includes [byte]: sixteen times that of the
largest model of a robot in example-robot-data, 1 MB."""
_MOST_ELEMENTS = 8_000
"""Largest number of elements of the expanded model: 4,000 bodies with a geom each, which MuJoCo
reads in about 2 s; the files of robots in `tests/data/robots` have 90 to 450."""
_DEEPEST = 200
"""Levels of elements: MuJoCo descends by recursion; robots have 20 levels."""
_SOFT = ("flexcomp", "composite")
"""Elements of many nodes: MuJoCo takes 43 s for 10,000 of them."""
_PREFIX = re.compile(r"<([A-Za-z_][\w.-]*):")
_XACRO = "{http://www.ros.org/wiki/xacro}"
Element = ElementTree.Element


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
    root: Element

    @classmethod
    def of(cls, path: Path) -> "ModelSource":
        """Read a file.

        Raises:
            NotFoundError: there is no such file.
            ParameterError: it is no MJCF or URDF, or larger than any robot.
        """
        files = _Files(path)
        text, root = files.read(path)
        if root.tag not in ("mujoco", "robot"):
            raise ParameterError(
                f"{path}: is neither MJCF (<mujoco>) nor URDF (<robot>): begins with <{root.tag}>"
            )
        files.expanded(root, path, (), 0)
        return cls(path, text, root)

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
        """Top speed of each joint for which a URDF states one above 0, by name [rad/s, m/s].

        Raises:
            ParameterError: a velocity that is no number.
        """
        joints = self.root.findall("joint")  # a transmission names its joint again
        limits = {joint.get("name", ""): joint.find("limit") for joint in joints}
        stated = {n: x.get("velocity", "0") for n, x in limits.items() if x is not None}
        try:
            speeds = {name: float(text) for name, text in stated.items()}
        except ValueError as cause:
            raise ParameterError(f"{self.path}: velocity of a joint's limit: {cause}") from None
        return {name: speed for name, speed in speeds.items() if 0.0 < speed < math.inf}

    def fixed_joints(self) -> dict[str, str]:
        """Child link of each fixed joint of a URDF."""
        return {
            joint.get("name", ""): child.get("link", "")
            for joint in self.root.findall("joint[@type='fixed']")
            for child in joint.findall("child")[:1]
        }

    def mimics(self) -> list[tuple[str, str, float]]:
        """Names of each joint of a URDF that mimics another one, of that one, and its offset
        [rad, m].

        Raises:
            ParameterError: an offset that is no number.
        """
        mimics = [
            (joint.get("name", ""), str(mimic.get("joint")), mimic.get("offset", "0"))
            for joint in (self.root.findall("joint") if self.urdf else ())
            for mimic in joint.findall("mimic")
        ]
        try:
            return [(one, other, float(offset)) for one, other, offset in mimics]
        except ValueError as cause:
            raise ParameterError(f"{self.path}: offset of a mimic joint: {cause}") from None


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


def _declared(text: str) -> str:
    """XML in which the prefixes of elements that no one declares are declared at its root: MuJoCo
    reads such files, as Drake's ``<drake:joint>``."""
    for prefix in dict.fromkeys(_PREFIX.findall(text)):
        if f"xmlns:{prefix}=" not in text:
            text = re.sub(r"<(robot|mujoco)\b", rf'<\1 xmlns:{prefix}="{prefix}"', text, count=1)
    return text


class _Files:
    """Text files that belong to one model, each read once."""

    def __init__(self, main: Path) -> None:
        self._folder, self._remaining = main.parent, _MOST_BYTES
        self._read: dict[Path, tuple[str, Element]] = {}

    def read(self, path: Path) -> tuple[str, Element]:
        """Text and root element of a file."""
        place = path.resolve()
        if place not in self._read:
            raw = content(path, self._remaining)
            self._remaining -= len(raw)
            try:
                text = raw.decode()
                if "<!DOCTYPE" in text or "<!ENTITY" in text:
                    raise ParameterError(
                        f"{path}: defines entities: leave them out, no robot needs them"
                    )
                text = _declared(text)
                self._read[place] = text, ElementTree.fromstring(text)
            except UnicodeDecodeError:
                raise ParameterError(f"{path}: is no text: state an MJCF or URDF file") from None
            except ElementTree.ParseError as cause:
                raise ParameterError(f"{path}: is no MJCF or URDF: not XML ({cause})") from None
        return self._read[place]

    def expanded(self, element: Element, path: Path, parents: tuple[Path, ...], level: int) -> int:
        """Number of elements that an element of a file expands to, itself included.

        Args:
            element, path: of the file that holds it.
            parents: files that include or attach that one.
            level: depth so far.

        Raises:
            ParameterError: more than any robot has, or endless.
        """
        if level > _DEEPEST:
            raise ParameterError(
                f"{path}: nested more than {_DEEPEST} levels deep: give a flat one"
            )
        if element.tag in _SOFT:
            raise ParameterError(f"{path}: holds a <{element.tag}>: leave it out, no arm has one")
        total = 1
        if element.tag in ("include", "attach") and (file := self._named(element, path)):
            inside = (*parents, path.resolve())
            if file.resolve() in inside:
                raise ParameterError(f"{file}: includes or attaches itself: leave that out")
            total += self.expanded(self.read(file)[1], file, inside, level + 1)
        for inner in element:
            total += self.expanded(inner, path, parents, level + 1)
            if total > _MOST_ELEMENTS:
                break
        if element.tag == "replicate" and (count := element.get("count", "")).isdecimal():
            total *= max(int(count[:18]), 1)
        if total > _MOST_ELEMENTS:
            raise ParameterError(
                f"{path}: expands to more than {_MOST_ELEMENTS:,} elements (with replicate, "
                "include, attach): leave out what is no part of the robot"
            )
        return total

    def _named(self, element: Element, path: Path) -> Path | None:
        """The file that an element includes or attaches, beside the one that names it or the main
        one, or in its folder of assets; None if there is none."""
        name, root = element.get("file", ""), self.read(path)[1]
        if element.tag == "attach":
            models = {x.get("name"): x.get("file", "") for x in root.iter("model")}
            name = models.get(element.get("model"), "")
        settings = root.findall("compiler")
        inner = ["", *(c.get(d, "") for c in settings for d in ("assetdir", "meshdir"))]
        places = [folder / d / name for folder in (path.parent, self._folder) for d in inner]
        return next((p for p in places if p.exists()), None) if name else None
