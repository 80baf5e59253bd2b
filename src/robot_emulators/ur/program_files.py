"""Programs that the dashboard can load: files of a folder, and one that always exists.

A .script file is URScript. A .urp file is the maker's tree of nodes, as XML, gzipped or not; its
nodes are converted to URScript. Supported are assignments, scripts, script lines, if without else,
loops, waits, moves by waypoints, threads and comments: with these the maker's own examples play.
Other nodes are refused by name. External Control nodes fetch their program from a computer.
"""

import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from robot_emulators.ur.urscript.machine import LONGEST

EXTERNAL = "external_control.urp"
_LARGEST = 1 << 22
"""Largest size of a program file, unpacked [byte]."""
_SIGNS = {"≟": "==", "≠": "!=", "≤": "<=", "≥": ">=", "×": "*", "÷": "/"}
_MOVES = {"MoveJ": "movej", "MoveL": "movel", "MoveP": "movep"}


class ProgramFileError(Exception):
    """Raised for a program file that contains no program or an unsupported one."""


class Loaded(NamedTuple):
    """A loaded program: file name and URScript text (empty if it is fetched from a computer)."""

    name: str
    text: str


def load(folder: Path | None, name: str) -> Loaded | None:
    """Load a program of a folder by its file name; None if the folder has no such file. Raises a
    `ProgramFileError` if the file cannot be played.
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
    """Convert UR program ``name`` (.urp) to URScript; empty if it only has an External Control
    node."""
    try:
        if data[:2] == b"\x1f\x8b":
            data = zlib.decompressobj(16 + zlib.MAX_WBITS).decompress(data, _LARGEST)
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data or len(data) > _LARGEST:
            raise ProgramFileError(f"{name}: not the XML of a program")
        root = ET.fromstring(data)
    except (zlib.error, ET.ParseError) as error:
        raise ProgramFileError(f"{name}: {error}") from error
    return _Converter(root, name).text()


class _Converter:
    """Converts the node tree of a .urp file, a UR robot's program, to URScript."""

    def __init__(self, root: ET.Element, name: str) -> None:
        self._root, self._name = root, name
        self._parents = {child: parent for parent in root.iter() for child in parent}

    def text(self) -> str:
        """URScript of the whole program; empty if it only has an External Control node."""
        nodes = _children(self._root)
        main = [child for node in nodes if node.tag == "MainProgram" for child in _children(node)]
        contributed = [node for node in self._root.iter() if node.tag == "Contributed"]
        if contributed:
            others = [node for node in main if node.tag not in ("Contributed", "Comment")]
            external = "External Control" in contributed[0].get("strategyURCapName", "")
            if others or len(contributed) > 1 or not external:
                raise self._unknown((others or contributed)[0])
            return ""
        return "\n".join(self._program(nodes)) + "\n"

    def _program(self, nodes: list[ET.Element]) -> Iterator[str]:
        yield f"def {_word(self._root.get('name', 'program'))}():"
        for node in nodes:
            if node.tag == "SpecialSequence":
                yield from self._block(node)
        for k, node in enumerate([node for node in nodes if node.tag == "Thread"], 1):
            yield f"thread Thread_{k}():"
            yield from self._repeated(node)
            yield from ("end", f"threadId_Thread_{k} = run Thread_{k}()")
        for node in nodes:
            if node.tag == "MainProgram":
                yield from self._repeated(node)
        yield "end"

    def _repeated(self, node: ET.Element) -> Iterator[str]:
        if node.get("runOnlyOnce") == "true":
            yield from self._block(node)
        else:
            yield "while True:"
            yield from self._block(node)
            yield from ("sync()", "end")

    def _block(self, node: ET.Element) -> Iterator[str]:
        for child in _children(node):
            yield from self._node(child)

    def _node(self, node: ET.Element) -> Iterator[str]:
        kind = node.get("type")
        match node.tag:
            case "Comment" | "InitVariablesNode":
                pass
            case "Assignment":
                name = self._variable(self._needed(node, "variable"))
                yield f"global {name} = {self._expression(node)}"
            case "Script" if kind == "Line":
                yield self._expression(node)
            case "Script" if content := node.findtext("cachedContents"):
                yield from content.splitlines()
            case "If":
                yield f"if {self._expression(node)}:"
                yield from (*self._block(node), "end")
            case "Loop" if kind in ("While", "Forever"):
                yield f"while {self._expression(node) if kind == 'While' else 'True'}:"
                yield from (*self._block(node), "end")
            case "Wait" if kind == "Sleep" and (seconds := node.findtext("waitTime")):
                yield f"sleep({float(seconds)})"
            case "Move" if move := _MOVES.get(node.get("motionType", "")):
                a, v = float(node.get("acceleration", "1.2")), float(node.get("speed", "0.25"))
                for point in _children(node):
                    yield f"{move}({self._goal(point)}, a={a}, v={v})"
            case _:
                raise self._unknown(node)

    def _goal(self, point: ET.Element) -> str:
        kind, angles = point.get("type"), point.find("position/JointAngles")
        if point.tag == "Waypoint" and kind == "Variable":
            return self._variable(self._needed(point, "variable"))
        if point.tag == "Waypoint" and kind == "Fixed" and angles is not None:
            return "[" + ", ".join(str(float(v)) for v in angles.get("angles", "").split(",")) + "]"
        raise self._unknown(point)

    def _needed(self, node: ET.Element, tag: str) -> ET.Element:
        child = node.find(tag)
        if child is None:
            raise self._unknown(node)
        return child

    def _expression(self, node: ET.Element) -> str:
        words = []
        for part in self._needed(node, "expression"):
            if part.tag == "ExpressionVariable":
                words.append(self._variable(part[0]))
            else:
                word = part.get("character") or part.get("token") or ""
                words.append(_SIGNS.get(word, word))
        return "".join(words)

    def _variable(self, node: ET.Element) -> str:
        """Name of the variable in a node, or in the node that it refers to by a path."""
        for step in node.get("reference", "").split("/"):
            if step == "..":
                node = self._parents.get(node, node)
            elif step:
                tag, _, place = step.rstrip("]").partition("[")
                children = node.findall(tag)
                k = int(place or 1) - 1
                if not 0 <= k < len(children):
                    raise ProgramFileError(f"{self._name}: a variable that is not there: {step}")
                node = children[k]
        if not node.get("name"):
            raise self._unknown(node)
        return _word(str(node.get("name")))

    def _unknown(self, node: ET.Element) -> ProgramFileError:
        kind = node.get("type") or node.get("strategyURCapName") or ""
        return ProgramFileError(f"{self._name}: a node {node.tag} {kind} is not known here".strip())


def _children(node: ET.Element) -> list[ET.Element]:
    children = node.find("children")
    return [] if children is None else list(children)


def _word(name: str) -> str:
    """Turn a name into an identifier that URScript accepts."""
    kept = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in name)
    return kept if kept and not kept[0].isdigit() else f"_{kept}"
