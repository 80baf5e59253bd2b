"""Programs that the dashboard can load: files of a folder, and one that is always there.

A .script file is URScript. A .urp file is the maker's tree of nodes, as XML, packed or not; its
nodes become URScript (`program_tree`). The node of the External Control URCap asks a computer for
its program when it plays.
"""

import xml.etree.ElementTree as ET
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from robot_emulators.ur.program_tree import Converter, ProgramFileError
from robot_emulators.ur.urscript.machine import LONGEST

EXTERNAL = "external_control.urp"
_LARGEST = 1 << 22
"""Bytes of a file, unpacked."""


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
    return Converter(root, name).text()
