"""Plug-ins: a folder is its registry, and other packages add to it through entry points.

A plug-in of kind ``robots`` is a module or package ``wrenchbed/robots/<name>`` with one public
constant in the kind's name (``ROBOT``, ``SENSOR``, ``DRIVER``, ``EFFECT``, …), or an entry point of
another package in the group ``wrenchbed.robots`` that loads such an object. A sensor is a file
``wrenchbed/sensors/<name>.toml`` instead; emulators are those that `robot_emulators` lists.

A robot or a sensor may also come from a user's TOML file: its path stands for its name. What a
recording made with it carries (`record_of`) makes it known to whoever reads the recording
(`remember`).
"""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from wrenchbed.errors import MissingExtraError, NotFoundError, did_you_mean

KINDS = {
    "robots": "ROBOT",
    "sensors": "SENSOR",
    "drivers": "DRIVER",
    "transducers": "TRANSDUCER",
    "emulators": "EMULATOR",
    "effects": "EFFECT",
    "exports": "EXPORT",
}
"""Kind (the folder's name) → the constant that a plug-in's module holds."""

_PACKAGES = {
    "robots": "wrenchbed.robots",
    "sensors": "wrenchbed.sensors",
    "drivers": "wrenchbed.hardware.drivers",
    "transducers": "wrenchbed.hardware.transducers",
    "effects": "wrenchbed.effects",
    "exports": "wrenchbed.exports",
}
"""Kind → the package whose modules are its plug-ins, but `base` and what its `SUPPORT` names."""


_DESCRIBED = {
    "robots": "wrenchbed.robots.described",
    "sensors": "wrenchbed.sensors.described",
}
"""Kind → the module that reads such an object from a file, or from what `record_of` gave."""
_FILES = (".toml",)
_MODELS = (".xml", ".mjcf", ".urdf", ".xacro")
"""Suffixes of models that need to be described first."""
_records: dict[tuple[str, str], Mapping[str, Any]] = {}
_known: dict[tuple[str, str], Any] = {}


def plugin_modules(kind: str) -> tuple[str, ...]:
    """Names of the modules that hold the plug-ins of a kind.

    Raises:
        NotFoundError: the kind does not exist.
    """
    _check_kind(kind)
    return tuple(sorted(_modules(kind).values()))


@cache
def _modules(kind: str) -> dict[str, str]:
    if kind not in _PACKAGES:
        return {}
    package = importlib.import_module(_PACKAGES[kind])
    support = {"base", *getattr(package, "SUPPORT", ())}
    found = pkgutil.iter_modules(package.__path__)
    return {_public(kind, m.name): m.name for m in found if m.name not in support}


def _public(kind: str, module: str) -> str:
    """``ati_gamma`` is ati-gamma; an effect's module ``joint_gear_error`` is joint.gear_error."""
    return module.replace("_", ".", 1) if kind == "effects" else module.replace("_", "-")


@cache
def _tables(kind: str) -> dict[str, Path]:
    """Files of this package that describe a plug-in, by its name."""
    if kind not in _DESCRIBED:
        return {}
    package = importlib.import_module(_PACKAGES[kind])
    files = (f for folder in package.__path__ for f in Path(folder).glob("*.toml"))
    return {_public(kind, f.stem): f for f in files}


def _listed(kind: str) -> Mapping[str, str]:
    """Plug-ins that another package lists and loads itself."""
    if kind != "emulators":
        return {}
    listed: Mapping[str, str] = importlib.import_module("robot_emulators").EMULATORS
    return listed


@cache
def _shipped(kind: str, name: str) -> Any:
    return importlib.import_module(_DESCRIBED[kind]).shipped(_tables(kind)[name])


@cache
def _entry_points(kind: str) -> dict[str, Any]:
    return {e.name: e for e in entry_points(group=f"wrenchbed.{kind}")}


def names(kind: str) -> tuple[str, ...]:
    """Names of all plug-ins of a kind, sorted.

    Raises:
        NotFoundError: the kind does not exist.
    """
    _check_kind(kind)
    return tuple(sorted({*_modules(kind), *_tables(kind), *_listed(kind), *_entry_points(kind)}))


def load(kind: str, name: str) -> Any:
    """The plug-in's object, imported on use.

    Raises:
        NotFoundError: no such kind or name; the message lists what exists.
        MissingExtraError: the plug-in needs a library of an extra that is not installed.
        ParameterError: the file that describes it is wrong.
    """
    if kind in _DESCRIBED and name.lower().endswith(_FILES):
        return _from_file(kind, Path(name))
    if (kind, name) in _records:
        return _remembered(kind, name)
    known = names(kind)
    if name not in known:
        if kind == "robots" and name.lower().endswith(_MODELS):
            raise NotFoundError(
                f"{name} is a model, not yet a robot: make one with  "
                f"wrenchbed robot {name} --frame NAME --out my.toml  and state my.toml"
            )
        hint = did_you_mean(name, known) or "."
        raise NotFoundError(f"there is no {kind[:-1]} {name!r}{hint} Known: {', '.join(known)}")
    if name in _tables(kind):
        return _shipped(kind, name)
    if name in _listed(kind):
        return importlib.import_module("robot_emulators").load(name)
    module = _modules(kind).get(name)
    if module is None:
        return _entry_points(kind)[name].load()
    return getattr(importlib.import_module(f"{_PACKAGES[kind]}.{module}"), KINDS[kind])


def _from_file(kind: str, path: Path) -> Any:
    """What a file describes; the same object as long as the file says the same."""
    found = importlib.import_module(_DESCRIBED[kind]).read(path)
    _records.setdefault((kind, found.name), found.record)
    return _known.setdefault((kind, found.name), found)


def _remembered(kind: str, name: str) -> Any:
    if (kind, name) not in _known:
        found = importlib.import_module(_DESCRIBED[kind]).rebuilt(_records[kind, name])
        if found.name != name:
            raise NotFoundError(f"there is no {name!r}: what the file carries is {found.name!r}")
        _known[kind, name] = found
    return _known[kind, name]


def remember(kind: str, name: str, record: Mapping[str, Any]) -> None:
    """Make known what a file carries about an object that a user described.

    A plug-in's name keeps meaning the plug-in.
    """
    if name not in names(kind):
        _records.setdefault((kind, name), record)


def revived(kind: str, name: str, record: Mapping[str, Any]) -> Any:
    """The object of a name and of what a file carries about it."""
    remember(kind, name, record)
    return load(kind, name)


def record_of(kind: str, name: str) -> Mapping[str, Any] | None:
    """What a file has to carry so that others can load an object by name; None of plug-ins."""
    return _records.get((kind, name))


def known_as(kind: str, name: str) -> str:
    """The name under which files name an object: that of a user's file, else ``name`` itself.

    Raises:
        NotFoundError, ParameterError: the user's file cannot be read.
    """
    is_file = kind in _DESCRIBED and name.lower().endswith(_FILES)
    return str(_from_file(kind, Path(name)).name) if is_file else name


def is_known(kind: str, name: str) -> bool:
    """Whether `load` finds it: a plug-in, a user's file, or one that a file has made known."""
    if kind in _DESCRIBED and name.lower().endswith(_FILES):
        return Path(name).is_file()
    return (kind, name) in _records or name in names(kind)


def descriptions(kind: str) -> dict[str, str]:
    """One line on each plug-in of a kind, by name: its title, or its docstring's first line.

    Raises:
        NotFoundError: the kind does not exist.
        MissingExtraError: a plug-in needs a library of an extra that is not installed.
    """
    plugins = {name: load(kind, name) for name in names(kind)}
    return {
        name: str(getattr(p, "title", None) or (p.__doc__ or "").strip().splitlines()[0])
        for name, p in plugins.items()
    }


def require(library: str, extra: str) -> Any:
    """Import an optional library, or name the extra that installs it.

    Raises:
        MissingExtraError: the library is not installed.
    """
    try:
        return importlib.import_module(library)
    except ModuleNotFoundError as error:
        checkout = (Path(__file__).resolve().parents[2] / "pyproject.toml").is_file()
        command = f"-e '.[{extra}]'  in the clone" if checkout else f"'wrenchbed[{extra}]'"
        raise MissingExtraError(
            f"{library} is not installed: run  pip install {command}"
        ) from error


def _check_kind(kind: str) -> None:
    if kind not in KINDS:
        raise NotFoundError(f"there is no kind {kind!r} of plug-in. Known: {', '.join(KINDS)}")
