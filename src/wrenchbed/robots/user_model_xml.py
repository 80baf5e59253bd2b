"""MJCF and URDF of a user as XML, before MuJoCo reads the file."""

import math
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from wrenchbed.errors import NotFoundError, ParameterError

_MOST_BYTES = 2**24
"""Largest size of a model's text [byte]: sixteen times that of the largest model of a robot in
example-robot-data, 1 MB."""
_PREFIX = re.compile(r"<([A-Za-z_][\w.-]*):")
_XACRO = "{http://www.ros.org/wiki/xacro}"
Element = ElementTree.Element


@dataclass(frozen=True)
class ModelSource:
    """A model file, MJCF or URDF, that was read as XML.

    Attributes:
        path: path of the file.
        text: content of the file.
        root: its root element, ``<mujoco>`` or ``<robot>``.
    """

    path: Path
    text: str
    root: Element

    @classmethod
    def of(cls, path: Path) -> "ModelSource":
        """Read and parse a model file. Raises a `NotFoundError` if there is no such file, a
        `ParameterError` if it is no MJCF or URDF, or larger than any robot."""
        try:
            text = content(path).decode()
            if "<!DOCTYPE" in text or "<!ENTITY" in text:
                raise ParameterError(
                    f"{path}: defines entities: leave them out, no robot needs them"
                )
            for prefix in dict.fromkeys(_PREFIX.findall(text)):  # as Drake's <drake:joint>
                if f"xmlns:{prefix}=" not in text:  # MuJoCo reads files that do not declare it
                    start = rf'<\1 xmlns:{prefix}="{prefix}"'
                    text = re.sub(r"<(robot|mujoco)\b", start, text, count=1)
            root = ElementTree.fromstring(text)
        except UnicodeDecodeError:
            raise ParameterError(f"{path}: is no text: state an MJCF or URDF file") from None
        except ElementTree.ParseError as cause:
            raise ParameterError(f"{path}: is no MJCF or URDF: not XML ({cause})") from None
        if root.tag not in ("mujoco", "robot"):
            raise ParameterError(
                f"{path}: is neither MJCF (<mujoco>) nor URDF (<robot>): begins with <{root.tag}>"
            )
        return cls(path, text, root)

    @property
    def urdf(self) -> bool:
        """Whether the file is URDF; otherwise it is MJCF."""
        return self.root.tag == "robot"

    def check_expanded(self) -> None:
        """Raise `ParameterError` for unexpanded xacro, with the command that expands it."""
        for element in self.root.iter():
            macro = str(element.tag).startswith(_XACRO)
            if macro or any("${" in v or "$(" in v for v in element.attrib.values()):
                tag = str(element.tag).replace(_XACRO, "xacro:")
                raise ParameterError(
                    f"{self.path}: holds unexpanded xacro (in <{tag}>): "
                    f"run  xacro {self.path.name} > robot.urdf  and state robot.urdf"
                )

    def speeds(self) -> dict[str, float]:
        """Joint name → top speed [rad/s, m/s] in a URDF; `ParameterError` if one is no number."""
        joints = self.root.findall("joint")  # a transmission names its joint again
        limits = {joint.get("name", ""): joint.find("limit") for joint in joints}
        stated = {n: x.get("velocity", "0") for n, x in limits.items() if x is not None}
        try:
            speeds = {name: float(text) for name, text in stated.items()}
        except ValueError as cause:
            raise ParameterError(f"{self.path}: velocity of a joint's limit: {cause}") from None
        return {name: speed for name, speed in speeds.items() if 0.0 < speed < math.inf}

    def fixed_joints(self) -> dict[str, str]:
        """Name → child link of each fixed joint of a URDF."""
        return {
            joint.get("name", ""): child.get("link", "")
            for joint in self.root.findall("joint[@type='fixed']")
            for child in joint.findall("child")[:1]
        }

    def mimics(self) -> list[tuple[str, str, float]]:
        """For each mimic joint of a URDF: its name, the imitated joint's, and the offset [rad or
        m]; a `ParameterError` for an offset that is no number."""
        mimics = [
            (joint.get("name", ""), str(mimic.get("joint")), mimic.get("offset", "0"))
            for joint in (self.root.findall("joint") if self.urdf else ())
            for mimic in joint.findall("mimic")
        ]
        try:
            return [(one, other, float(offset)) for one, other, offset in mimics]
        except ValueError as cause:
            raise ParameterError(f"{self.path}: offset of a mimic joint: {cause}") from None


def content(path: Path) -> bytes:
    """Read the bytes of a model file. A `NotFoundError` if there is none, a `ParameterError` for a
    device, a pipe, a folder, or more than 16 MB."""
    try:
        there = path.stat()
        if not stat.S_ISREG(there.st_mode):
            raise ParameterError(f"{path}: is no regular file: give an MJCF or URDF file")
        if there.st_size <= _MOST_BYTES:
            return path.read_bytes()
    except OSError as cause:
        raise NotFoundError(f"{path}: {cause.strerror or cause}") from None
    raise ParameterError(
        f"{path}: has {there.st_size:,} bytes, more than {_MOST_BYTES:,}: give a file of the robot "
        "alone"
    )
