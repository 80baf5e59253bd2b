"""Plug-ins: a folder is its registry, and other packages add to it through entry points.

A plug-in of kind ``robots`` is a module or package ``wrenchbed/robots/<name>`` with one public
constant in the kind's name (``ROBOT``, ``SENSOR``, ``DRIVER``, ``EFFECT``, …), or an entry point of
another package in the group ``wrenchbed.robots`` that loads such an object. A sensor is a file
``wrenchbed/sensors/<name>.toml`` instead; emulators are those that `robot_emulators` lists.

A robot or a sensor may also come from a user's TOML file: its path stands for its name. A recording
carries a copy of such a file (`record_of`), from which who reads the recording can load the object
(`remember`), until `forget`.
"""

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from wrenchbed.errors import MissingExtraError, NotFoundError, did_you_mean

KINDS = {
    "robots": ("wrenchbed.robots", "ROBOT"),
    "sensors": ("wrenchbed.sensors", "SENSOR"),
    "drivers": ("wrenchbed.hardware.drivers", "DRIVER"),
    "transducers": ("wrenchbed.hardware.transducers", "TRANSDUCER"),
    "emulators": ("robot_emulators", "EMULATOR"),
    "effects": ("wrenchbed.effects", "EFFECT"),
    "drives": ("wrenchbed.effects.drives", "EFFECT"),
    "exports": ("wrenchbed.exports", "EXPORT"),
    "channels": ("wrenchbed.channels", "CHANNEL"),
}
"""Kind → its package and the constant that each plug-in holds. Every module of the package is a
plug-in, except `base` and those that the package lists in its `SUPPORT`."""
_DESCRIBED = {kind: f"wrenchbed.{kind}.described" for kind in ("robots", "sensors")}
"""Kind → the module that makes such an object from a user's file or from a record (`record_of`)."""
_MODELS = (".xml", ".mjcf", ".urdf", ".xacro")
"""Suffixes of model files from which ``wrenchbed robot`` first has to make a robot's TOML file."""
_records: dict[tuple[str, str], Mapping[str, Any]] = {}
_known: dict[tuple[str, str], Any] = {}


@cache
def _entry_points(kind: str) -> dict[str, Any]:
    return {e.name: e for e in entry_points(group=f"wrenchbed.{kind}")}


def _loaders(kind: str) -> dict[str, Callable[[], Any]]:
    """Functions that load each plug-in of a kind, by name; wrenchbed's own win over others'."""
    if kind not in KINDS:
        raise NotFoundError(f"there is no kind {kind!r} of plug-in. Known: {', '.join(KINDS)}")
    return {name: entry.load for name, entry in _entry_points(kind).items()} | _own_loaders(kind)


@cache
def _own_loaders(kind: str) -> dict[str, Callable[[], Any]]:
    if kind == "emulators":
        emulators = importlib.import_module("robot_emulators")
        return {name: partial(emulators.load, name) for name in emulators.EMULATORS}
    loaders = {_public(kind, m): partial(_constant, kind, m) for m in plugin_modules(kind)}
    folders = importlib.import_module(KINDS[kind][0]).__path__ if kind in _DESCRIBED else ()
    for file in (f for folder in folders for f in Path(folder).glob("*.toml")):
        loaders[_public(kind, file.stem)] = partial(_shipped, kind, file)
    return dict(loaders)


@cache
def plugin_modules(kind: str) -> tuple[str, ...]:
    """Names of the modules of wrenchbed that hold the plug-ins of a kind."""
    package = importlib.import_module(KINDS[kind][0])
    support = {"base", *getattr(package, "SUPPORT", ())}
    return tuple(m.name for m in pkgutil.iter_modules(package.__path__) if m.name not in support)


def _public(kind: str, module: str) -> str:
    """Public name of a plug-in's module: ``ati-gamma`` of ati_gamma, ``joint.gear_error`` of an
    effect joint_gear_error, ``drive.coulomb`` of a drive's effect coulomb."""
    if kind == "drives":
        return f"drive.{module}"
    return module.replace("_", ".", 1) if kind == "effects" else module.replace("_", "-")


def _constant(kind: str, module: str) -> Any:
    package, constant = KINDS[kind]
    return getattr(importlib.import_module(f"{package}.{module}"), constant)


@cache
def _shipped(kind: str, file: Path) -> Any:
    return importlib.import_module(_DESCRIBED[kind]).shipped(file)


def names(kind: str) -> tuple[str, ...]:
    """Names of all plug-ins of a kind, sorted; a `NotFoundError` if the kind does not exist."""
    return tuple(sorted(_loaders(kind)))


def load(kind: str, name: str) -> Any:
    """Load a plug-in's object; its module is imported on use.

    Raises:
        NotFoundError: no such kind or name; the message lists what exists.
        MissingExtraError: the plug-in needs a library of an extra that is not installed.
        ParameterError: the file that describes it is wrong.
    """
    if _is_file(kind, name):
        return _from_file(kind, Path(name))
    if (kind, name) in _records:
        if (kind, name) not in _known:
            rebuilt = importlib.import_module(_DESCRIBED[kind]).rebuilt(_records[kind, name])
            if rebuilt.name != name:
                raise NotFoundError(
                    f"there is no {name!r}: what the file carries is {rebuilt.name!r}"
                )
            _known[kind, name] = rebuilt
        return _known[kind, name]
    known = names(kind)
    if name in known:
        return _loaders(kind)[name]()
    if kind == "robots" and name.lower().endswith(_MODELS):
        raise NotFoundError(
            f"{name} is a model, not yet a robot: make one with  "
            f"wrenchbed robot {name} --frame NAME --out my.toml  and state my.toml"
        )
    hint = did_you_mean(name, known) or "."
    raise NotFoundError(f"there is no {kind[:-1]} {name!r}{hint} Known: {', '.join(known)}")


def _is_file(kind: str, name: str) -> bool:
    """Whether a name is the path of a user's TOML file of this kind (robots or sensors)."""
    return kind in _DESCRIBED and name.lower().endswith(".toml")


def _from_file(kind: str, path: Path) -> Any:
    """Load the object that a user's TOML file describes; it is kept while the file is unchanged."""
    described = importlib.import_module(_DESCRIBED[kind]).read(path)
    _records.setdefault((kind, described.name), described.record)
    return _known.setdefault((kind, described.name), described)


def remember(kind: str, name: str, record: Mapping[str, Any]) -> None:
    """Register the content of a user's robot or sensor file as ``record``, to load it by ``name``;
    plug-ins of that name win."""
    if name not in names(kind):
        _records.setdefault((kind, name), record)


def forget() -> Callable[[], None]:
    """Forget all users' robots and sensors (for tests); return a function that restores them."""
    records, known = dict(_records), dict(_known)

    def undo() -> None:
        forget()
        _records.update(records)
        _known.update(known)

    _records.clear()
    _known.clear()
    return undo


def revived(kind: str, name: str, record: Mapping[str, Any]) -> Any:
    """Load the user's robot or sensor ``name`` from ``record``, the content of its file."""
    remember(kind, name, record)
    return load(kind, name)


def record_of(kind: str, name: str) -> Mapping[str, Any] | None:
    """Content of a user's robot or sensor file, which recordings copy; None for a plug-in."""
    return _records.get((kind, name))


def known_as(kind: str, name: str) -> str:
    """The name under which files name an object: the one inside a user's TOML file, else ``name``.
    A `NotFoundError` or `ParameterError` if the user's file cannot be read."""
    return str(_from_file(kind, Path(name)).name) if _is_file(kind, name) else name


def is_known(kind: str, name: str) -> bool:
    """Whether `load` finds a name: of a plug-in, a user's file, or what `remember` registered."""
    if _is_file(kind, name):
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
