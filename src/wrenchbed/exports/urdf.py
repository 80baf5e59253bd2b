"""URDF: the load and the sensor's place written into the user's own file.

The load becomes the ``<inertial>`` of the sensor's link, in its axes. The sensor's place in the
flange becomes the ``<origin>`` of the joint that carries this link.
"""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.errors import ExportError, did_you_mean
from wrenchbed.exports.base import XML, Export, ExportOptions
from wrenchbed.exports.load_numbers import FLANGE, LoadNumbers

_FRAME = "ft_frame"
_LARGEST = 1 << 26
"""Largest URDF that is read [B]; those of whole robots are below 1 MiB."""
_INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


class Urdf(Export):
    """Export format for URDF: edits a user's URDF text; notes are comments in <inertial>."""

    name = "urdf"
    title = "the user's URDF with the load and the sensor's frame"
    source = "http://wiki.ros.org/urdf/XML/link and http://wiki.ros.org/urdf/XML/joint"
    comment = XML
    carries = ("mass", "cog_sensor", "inertia_sensor", "rotation", "position")

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        if options.urdf is None:
            raise ExportError("urdf: name your own file with --urdf FILE")
        frame, robot = options.frame or _FRAME, _parsed(options.urdf)
        links = {e.get("name", ""): e for e in robot.findall("link")}
        joints = [(e, _linked(e, "parent"), _linked(e, "child")) for e in robot.findall("joint")]
        if frame not in links:
            raise ExportError(
                f"urdf: there is no link {frame!r}{did_you_mean(frame, links) or '.'} State the "
                f"sensor's link with --frame; the file has {', '.join(sorted(links))}"
            )
        behind = [frame]
        for name in behind:  # grows
            behind += [c for _, p, c in joints if p == name and c in links and c not in behind]
        if carried := [n for n in behind[1:] if links[n].find("inertial") is not None]:
            raise ExportError(
                f"urdf: {', '.join(carried)} behind {frame!r} have masses of their own: the load "
                "would weigh twice. Remove their <inertial> first"
            )
        self._load(_part(links[frame], "inertial"), numbers, notes)
        carrying = [joint for joint, _, child in joints if child == frame]
        if carrying and numbers.frame == FLANGE:
            rpy = Rotation.from_rotvec(numbers.rotation.needed(self.name)).as_euler("xyz")
            xyz = numbers.position.needed(self.name)
            _part(carrying[0], "origin").attrib = {"xyz": _words(xyz), "rpy": _words(rpy)}
        return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'

    def _load(self, inertial: Element, numbers: LoadNumbers, notes: Sequence[str]) -> None:
        """Write mass, CoG and inertia (if identified) to an <inertial> element, ``notes`` as its
        comments."""
        cog, mass = numbers.cog_sensor.needed(self.name), numbers.mass.needed(self.name)[0]
        inertia = inertial.find("inertia")
        if numbers.inertia_sensor.known:
            six = zip(_INERTIA, numbers.inertia_sensor.value, strict=True)
            inertia = Element("inertia", {n: repr(float(v)) for n, v in six})
        elif inertia is None:
            raise ExportError(
                "urdf: the inertia was not identified, and the sensor's link states none: "
                "record a motion, or give the link an <inertial> with an <inertia> to keep"
            )
        comment = self.commented(notes).removeprefix(XML).removesuffix("-->")
        inertial[:] = [
            ElementTree.Comment(comment),
            Element("origin", xyz=_words(cog), rpy="0 0 0"),
            Element("mass", value=repr(float(mass))),
            inertia,
        ]
        ElementTree.indent(inertial, level=2)


def read_urdf(path: str | Path) -> str:
    """Read a URDF file's text; an `ExportError` if it is missing, too large or not UTF-8."""
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


def _parsed(text: str) -> Element:
    """Parse a URDF's text and return its robot element, comments included.

    Raises:
        ExportError: no XML, a document type (its entities could hide anything), or no robot.
    """
    if "<!DOCTYPE" in text:
        raise ExportError("urdf: a document type with entities is not read: remove <!DOCTYPE …>")
    builder = ElementTree.TreeBuilder(insert_comments=True)
    try:
        robot = ElementTree.fromstring(text, ElementTree.XMLParser(target=builder))
    except ElementTree.ParseError as error:
        raise ExportError(f"urdf: no valid XML: {error}") from error
    if robot.tag != "robot":
        raise ExportError(f"urdf: the file holds <{robot.tag}>, not <robot>")
    return robot


def _linked(joint: Element, side: str) -> str:
    """Name of the ``parent`` or ``child`` link (``side``) of a joint element; empty without one."""
    end = joint.find(side)
    return "" if end is None else end.get("link", "")


def _part(element: Element, tag: str) -> Element:
    """Return the child element with this tag, made if it is missing."""
    part = element.find(tag)
    if part is None:
        part = Element(tag)
        part.tail = "\n  "
        element.insert(0, part)
        element.text = element.text or "\n    "
    return part


def _words(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)


EXPORT = Urdf()
