"""URDF: the load and the sensor's place written into the user's own file, all else byte for byte.

The load becomes the ``<inertial>`` of the sensor's link, in its axes. The sensor's place in the
flange becomes the ``<origin>`` of the joint that carries this link.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.errors import ExportError, did_you_mean
from wrenchbed.exports.base import XML, Export, ExportOptions
from wrenchbed.exports.load_numbers import FLANGE, LoadNumbers

_FRAME = "ft_frame"
_LARGEST = 1 << 26
"""Largest URDF that is read [B]; those of whole robots are below 1 MiB."""
_TAG = re.compile(rb"""(?:[^"'>]|"[^"]*"|'[^']*')*>""")
"""A tag; > may stand in its attributes."""
_INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


class Urdf(Export):
    """Edits the user's text; the comments stand inside the inertial."""

    name = "urdf"
    title = "the user's URDF with the load and the sensor's frame"
    source = "http://wiki.ros.org/urdf/XML/link and http://wiki.ros.org/urdf/XML/joint"
    comment = XML
    carries = ("mass", "cog_sensor", "inertia_sensor", "rotation", "position")

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        if options.urdf is None:
            raise ExportError("urdf: name your own file with --urdf FILE")
        frame, robot = options.frame or _FRAME, _parsed(options.urdf)
        links = {e.attributes.get("name", ""): e for e in robot.parts if e.tag == "link"}
        joints = [(e, _linked(e, "parent"), _linked(e, "child"))
                  for e in robot.parts if e.tag == "joint"]  # fmt: skip
        if frame not in links:
            raise ExportError(
                f"urdf: there is no link {frame!r}{did_you_mean(frame, links) or '.'} State the "
                f"sensor's link with --frame; the file has {', '.join(sorted(links))}"
            )
        behind = [frame]
        for name in behind:  # grows
            behind += [c for _, p, c in joints if p == name and c in links and c not in behind]
        if carried := [n for n in behind[1:] if _child(links[n], "inertial")]:
            raise ExportError(
                f"urdf: {', '.join(carried)} behind {frame!r} have masses of their own: the load "
                "would weigh twice. Remove their <inertial> first"
            )
        text, link = options.urdf.encode(), links[frame]
        edits = [_edit(text, link, "inertial", self._inertial(text, numbers, link, notes))]
        carrying = [joint for joint, _, child in joints if child == frame]
        if carrying and numbers.frame == FLANGE:
            rpy = Rotation.from_rotvec(numbers.rotation.needed(self.name)).as_euler("xyz")
            xyz = numbers.position.needed(self.name)
            origin = f'<origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>'
            edits.append(_edit(text, carrying[0], "origin", origin))
        for start, end, new in sorted(edits, reverse=True):
            text = text[:start] + new.encode() + text[end:]
        return text.decode()

    def _inertial(
        self, text: bytes, numbers: LoadNumbers, link: "_Element", notes: Sequence[str]
    ) -> str:
        cog, mass = numbers.cog_sensor.needed(self.name), numbers.mass.needed(self.name)[0]
        old = _child(link, "inertial")
        kept = None if old is None else _child(old, "inertia")
        if numbers.inertia_sensor.known:
            six = zip(_INERTIA, numbers.inertia_sensor.value, strict=True)
            words = " ".join(f'{n}="{float(v)!r}"' for n, v in six)
            inertia = f"<inertia {words}/>"
        elif kept is not None:
            inertia = text[kept.start : kept.end].decode()
        else:
            raise ExportError(
                "urdf: the inertia was not identified, and the sensor's link states none: "
                "record a motion, or give the link an <inertial> with an <inertia> to keep"
            )
        return (
            f"<inertial>\n      {self.commented(notes)}\n"
            f'      <origin xyz="{_words(cog)}" rpy="0 0 0"/>\n'
            f'      <mass value="{float(mass)!r}"/>\n      {inertia}\n    </inertial>'
        )


def read_urdf(path: str | Path) -> str:
    """The text of a URDF.

    Raises:
        ExportError: there is no such file, it is too large, or no UTF-8; names it.
    """
    try:
        with Path(path).open("rb") as file:
            data = file.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise ExportError(f"{path}: is larger than {_LARGEST >> 20} MiB")
        return data.decode()
    except OSError as error:
        raise ExportError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ExportError(f"{path}: byte {error.start} is no UTF-8") from error


@dataclass
class _Element:
    """An element with its place in the text [bytes].

    Attributes:
        start, end: of the whole element.
        inside: where its content begins; None if it is written as one tag ``<…/>``.
    """

    tag: str
    attributes: Mapping[str, str]
    start: int
    end: int = 0
    inside: int | None = None
    parts: list["_Element"] = field(default_factory=list)


def _parsed(text: str) -> _Element:
    """The robot element with the places of all elements.

    Raises:
        ExportError: no XML, a document type (its entities could hide anything), or no robot.
    """
    data, parser = text.encode(), expat.ParserCreate()
    root = _Element("", {}, 0)
    open_elements = [root]

    def tag_end(start: int) -> int:
        whole = _TAG.match(data, start)
        return whole.end() if whole else len(data)

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(tag, attributes, parser.CurrentByteIndex)
        open_elements[-1].parts.append(element)
        open_elements.append(element)

    def end(tag: str) -> None:
        element = open_elements.pop()
        inside = tag_end(element.start)
        if data[inside - 2 : inside] == b"/>":
            element.end = inside
        else:
            element.end, element.inside = tag_end(parser.CurrentByteIndex), inside

    def refuse(*_: Any) -> None:
        raise ExportError("urdf: a document type with entities is not read: remove <!DOCTYPE …>")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ExportError(f"urdf: no valid XML: {error}") from error
    robot = root.parts[0]
    if robot.tag != "robot":
        raise ExportError(f"urdf: the file holds <{robot.tag}>, not <robot>")
    return robot


def _child(element: _Element, tag: str) -> _Element | None:
    return next((e for e in element.parts if e.tag == tag), None)


def _linked(joint: _Element, side: str) -> str:
    """Name of the link at one side of a joint, ``parent`` or ``child``; empty if it names none."""
    end = _child(joint, side)
    return "" if end is None else end.attributes.get("link", "")


def _edit(text: bytes, element: _Element, tag: str, new: str) -> tuple[int, int, str]:
    """Start, end and text of what puts a new part into an element, or replaces the old one."""
    old = _child(element, tag)
    if old is not None:
        return old.start, old.end, new
    if element.inside is not None:
        return element.inside, element.inside, f"\n    {new}"
    opened = text[element.start : element.end].decode().removesuffix("/>")
    return element.start, element.end, f"{opened}>\n    {new}\n  </{element.tag}>"


def _words(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)


EXPORT = Urdf()
