"""Programs that the dashboard can load: files of a folder, and one that is always there.

A .script file is URScript. A .urp file is the maker's tree of nodes, as XML, packed or not; here it
may hold waits, scripts, comments and folders of them: other nodes make the program one that cannot
be loaded. The node of the External Control URCap asks a computer for its program when it plays.
"""

import xml.etree.ElementTree as ET
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from robot_emulators.ur.urscript.machine import LONGEST

EXTERNAL = "external_control.urp"
_LARGEST = 1 << 22
"""Bytes of a file, unpacked."""


class ProgramFileError(Exception):
    """A file that holds no program, or none that is understood here."""


@dataclass(frozen=True)
class Loaded:
    """A program that can be played.

    Attributes:
        name: of its file.
        text: URScript; empty where it is asked for over the network.
    """

    name: str
    text: str


def load(folder: Path | None, name: str) -> Loaded | None:
    """A program of a folder by its file's name, with or without folders; None where there is none.

    Raises:
        ProgramFileError: the file is no program that can be played; says why.
    """
    bare = PurePosixPath(name.strip()).name
    path = None if folder is None or not bare else folder / bare
    if path is not None and path.is_file():
        return Loaded(bare, _text(path))
    return Loaded(bare, "") if bare == EXTERNAL else None


def _text(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ProgramFileError(f"{path.name}: {error.strerror}") from error
    if path.suffix == ".script":
        text = data.decode("utf-8", "replace")
    elif path.suffix == ".urp":
        text = _converted(data, path.name)
    else:
        raise ProgramFileError(f"{path.name}: neither .urp nor .script")
    if len(text) > LONGEST:
        raise ProgramFileError(f"{path.name}: longer than {LONGEST} characters")
    return text


def _converted(data: bytes, name: str) -> str:
    """A tree of nodes as URScript; empty where a node asks a computer for the program."""
    try:
        if data[:2] == b"\x1f\x8b":
            data = zlib.decompressobj(16 + zlib.MAX_WBITS).decompress(data, _LARGEST)
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data or len(data) > _LARGEST:
            raise ProgramFileError(f"{name}: not the XML of a program")
        root = ET.fromstring(data)
    except (zlib.error, ET.ParseError) as error:
        raise ProgramFileError(f"{name}: {error}") from error
    contributed = list(root.iter("Contributed"))
    if contributed:
        if all(node.get("strategyURCapName") == "External Control" for node in contributed):
            return ""
        raise _unknown(contributed[0], name)
    lines = [line for node in _children(root) for line in _block(node, name)]
    main = root.find("children/MainProgram")
    if main is not None and main.get("runOnlyOnce") != "true":
        lines = ["while True:", *lines, "sync()", "end"]
    return "\n".join(["def program():", *lines, "end", ""])


def _children(node: ET.Element) -> list[ET.Element]:
    return list(node.find("children") or [])


def _block(node: ET.Element, name: str) -> list[str]:
    """Lines of a node's children."""
    lines: list[str] = []
    for child in _children(node):
        seconds, content = child.findtext("waitTime"), child.findtext("cachedContents")
        if child.tag == "Folder":
            lines += _block(child, name)
        elif child.tag == "Wait" and child.get("type") == "Sleep" and seconds is not None:
            lines.append(f"sleep({float(seconds)})")
        elif child.tag == "Script" and content is not None:
            lines += content.splitlines()
        elif child.tag != "Comment":
            raise _unknown(child, name)
    return lines


def _unknown(node: ET.Element, name: str) -> ProgramFileError:
    kind = node.get("type") or node.get("strategyURCapName") or ""
    return ProgramFileError(f"{name}: a node {node.tag} {kind} is not known here".strip())
