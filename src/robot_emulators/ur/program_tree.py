"""The maker's tree of nodes (.urp) as URScript, as far as its nodes are known here.

Known are assignments, scripts and script lines, if without else, loops, waits, moves by waypoints,
threads, folders and comments: with these the maker's own examples play. Others are refused by name.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import ClassVar

_SIGNS = {"≟": "==", "≠": "!=", "≤": "<=", "≥": ">=", "×": "*", "÷": "/"}


class ProgramFileError(Exception):
    """A file that holds no program, or none that is understood here."""


class Converter:
    """Nodes of a program to URScript."""

    def __init__(self, root: ET.Element, name: str) -> None:
        self._root, self._name = root, name
        self._parents = {child: parent for parent in root.iter() for child in parent}
        self._lines: list[str] = []

    def text(self) -> str:
        """The whole program; empty where its only node asks a computer for it."""
        nodes = self._children(self._root)
        if any(n.tag == "Contributed" for n in self._root.iter()):
            return self._contributed()
        self._write(0, f"def {_word(self._root.get('name', 'program'))}():")
        for node in nodes:
            if node.tag == "SpecialSequence":
                self._block(node, 1)
        threads = [node for node in nodes if node.tag == "Thread"]
        for k, node in enumerate(threads):
            self._write(1, f"thread Thread_{k + 1}():")
            self._repeated(node, 2)
            self._write(1, "end")
            self._write(1, f"threadId_Thread_{k + 1} = run Thread_{k + 1}()")
        for node in nodes:
            if node.tag == "MainProgram":
                self._repeated(node, 1)
        self._write(0, "end")
        return "\n".join(self._lines) + "\n"

    def _contributed(self) -> str:
        nodes = [n for n in self._root.iter() if n.tag == "Contributed"]
        rest = [n for n in self._children_of_main() if n.tag not in ("Contributed", "Comment")]
        if (
            len(nodes) != 1
            or rest
            or "External Control" not in nodes[0].get("strategyURCapName", "")
        ):
            raise self._unknown(rest[0] if rest else nodes[0])
        return ""

    def _children_of_main(self) -> list[ET.Element]:
        return [c for n in self._children(self._root) if n.tag == "MainProgram"
                for c in self._children(n)]  # fmt: skip

    def _repeated(self, node: ET.Element, depth: int) -> None:
        once = node.get("runOnlyOnce") == "true"
        if not once:
            self._write(depth, "while True:")
        self._block(node, depth + (not once))
        if not once:
            self._write(depth + 1, "sync()")
            self._write(depth, "end")

    @staticmethod
    def _children(node: ET.Element) -> list[ET.Element]:
        return list(node.find("children") or [])

    def _block(self, node: ET.Element, depth: int) -> None:
        for child in self._children(node):
            convert = self._nodes.get(child.tag)
            if convert is None:
                raise self._unknown(child)
            convert(self, child, depth)

    def _unknown(self, node: ET.Element) -> ProgramFileError:
        kind = node.get("type") or node.get("strategyURCapName") or ""
        return ProgramFileError(f"{self._name}: a node {node.tag} {kind} is not known here".strip())

    def _write(self, depth: int, line: str) -> None:
        self._lines.append("  " * depth + line)

    def _nothing(self, node: ET.Element, depth: int) -> None:
        """Comments and initial values of variables."""

    def _assignment(self, node: ET.Element, depth: int) -> None:
        name = self._variable(self._needed(node, "variable"))
        self._write(depth, f"global {name} = {self._expression(node)}")

    def _script(self, node: ET.Element, depth: int) -> None:
        if node.get("type") == "Line":
            self._write(depth, self._expression(node))
            return
        content = node.find("cachedContents")
        if content is None or content.text is None:
            raise self._unknown(node)
        for line in content.text.splitlines():
            self._write(depth, line)

    def _if(self, node: ET.Element, depth: int) -> None:
        self._write(depth, f"if {self._expression(node)}:")
        self._block(node, depth + 1)
        for child in self._children(node):
            if child.tag in ("ElseIf", "Else"):
                raise self._unknown(child)
        self._write(depth, "end")

    def _loop(self, node: ET.Element, depth: int) -> None:
        kind = node.get("type")
        if kind not in ("While", "Forever"):
            raise self._unknown(node)
        condition = self._expression(node) if kind == "While" else "True"
        self._write(depth, f"while {condition}:")
        self._block(node, depth + 1)
        self._write(depth, "end")

    def _wait(self, node: ET.Element, depth: int) -> None:
        seconds = node.findtext("waitTime")
        if node.get("type") != "Sleep" or seconds is None:
            raise self._unknown(node)
        self._write(depth, f"sleep({float(seconds)})")

    def _move(self, node: ET.Element, depth: int) -> None:
        kind = {"MoveJ": "movej", "MoveL": "movel", "MoveP": "movep"}.get(
            node.get("motionType", "")
        )
        for point in self._children(node):
            if kind is None or point.tag != "Waypoint":
                raise self._unknown(point if kind else node)
            goal = self._goal(point)
            a, v = float(node.get("acceleration", "1.2")), float(node.get("speed", "0.25"))
            self._write(depth, f"{kind}({goal}, a={a}, v={v})")

    def _goal(self, point: ET.Element) -> str:
        if point.get("type") == "Variable":
            return self._variable(self._needed(point, "variable"))
        angles = point.find("position/JointAngles")
        if point.get("type") == "Fixed" and angles is not None:
            return "[" + ", ".join(str(float(v)) for v in angles.get("angles", "").split(",")) + "]"
        raise self._unknown(point)

    def _halt(self, node: ET.Element, depth: int) -> None:
        self._write(depth, "halt")

    def _needed(self, node: ET.Element, tag: str) -> ET.Element:
        found = node.find(tag)
        if found is None:
            raise self._unknown(node)
        return found

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
        """A variable's name, where need be at the place that the node refers to."""
        for step in node.get("reference", "").split("/"):
            if step == "..":
                node = self._parents.get(node, node)
            elif step:
                tag, _, place = step.rstrip("]").partition("[")
                found = node.findall(tag)
                k = int(place or 1) - 1
                if not 0 <= k < len(found):
                    raise ProgramFileError(f"{self._name}: a variable that is not there: {step}")
                node = found[k]
        if not node.get("name"):
            raise self._unknown(node)
        return _word(str(node.get("name")))

    _nodes: ClassVar[dict[str, Callable[["Converter", ET.Element, int], None]]] = {
        "Assignment": _assignment, "Script": _script, "If": _if, "Loop": _loop, "Wait": _wait,
        "Move": _move, "Halt": _halt, "Comment": _nothing, "InitVariablesNode": _nothing,
        "Folder": lambda self, node, depth: self._block(node, depth),
    }  # fmt: skip


def _word(name: str) -> str:
    """A name that URScript takes."""
    kept = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in name)
    return kept if kept and not kept[0].isdigit() else f"_{kept}"
