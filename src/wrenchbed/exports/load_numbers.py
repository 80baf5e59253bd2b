"""The numbers of a fit or a twin that other programs use, each with its ± and its origin.

Every number is a function of the model's parameters θ. Its covariance is J C Jᵀ, with C of the fit
and J by complex steps. A number that depends on a parameter of which the data fix only a
combination is undetermined: it is never exported.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.data.metadata import known_name
from wrenchbed.errors import ExportError
from wrenchbed.files import checked
from wrenchbed.physics.rotations import exp
from wrenchbed.physics.taylor_jets import STEP
from wrenchbed.physics.wrench import CHANNELS, about_centre, six_of
from wrenchbed.robots.base import complex_steps
from wrenchbed.robots.oriented import ROBOT as ORIENTED
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.twin import Twin

FLANGE, SENSOR = "flange axes", "sensor axes"
_FLAT = 1e-9
"""Derivatives up to this size count as 0 [SI]: they are rounding."""
_UNIT = 1e-3
"""How far the norm of a quaternion may be from 1."""
_CARRIED = ("sensor.bias", "mount.", "base.tilt")
"""Starts of the names of parameters, beside those of the load, that some format carries."""
_BIAS = tuple(f"sensor.bias.{c}" for c in CHANNELS)
_TITLES = {
    "mass": ("mass", "kg"), "cog": ("CoG", "m"), "cog_sensor": ("CoG in sensor axes", "m"),
    "inertia": ("inertia about the CoG", "kg·m²"),
    "inertia_sensor": ("inertia about the CoG in sensor axes", "kg·m²"),
    "rotation": ("turn of the sensor", "rad"), "position": ("place of the sensor", "m"),
    "bias": ("zero of the sensor", "N, N·m"), "gravity": ("gravity in base axes", "m/s²"),
}  # fmt: skip
"""Title and unit of each quantity of `LoadNumbers`."""
_NO_LOAD = {"effort": "joint efforts", "pose": "a tracker's readings", "command": "commands"}
"""Fits that identify no load: value of their field ``channels`` → what was fitted, for messages."""
_OF_TWIN = ("format", "robot", "robot_model", "gravity", "theta", "effects", "recording")
"""Fields of a tracker fit's JSON that are needed to make a twin (corrected simulator)."""
Vectors = Mapping[str, np.ndarray]
"""Numbers computed from one θ: name → vector (K,)."""


class Origin(StrEnum):
    """Where an exported number comes from: the data, a statement, or nowhere (undetermined)."""

    IDENTIFIED = "identified from the data"
    STATED = "not identified: as the recording or the model states it"
    UNDETERMINED = "the data fix only a combination of it with others"


@dataclass(frozen=True, eq=False)
class Quantity:
    """A number or vector of a calibration, with its uncertainty and origin.

    Attributes:
        value: (K,) [unit].
        std: standard uncertainty (K,) [unit]; None if it is not known.
        unit: SI unit.
        origin: whether it comes from the data, from a statement, or is undetermined.
        why: if it is undetermined, the parameters of which the data fix only a combination.
    """

    name: str
    value: np.ndarray
    std: np.ndarray | None
    unit: str
    origin: Origin
    why: str = ""

    def needed(self, by: str) -> np.ndarray:
        """Value (K,), needed by the format ``by``; an `ExportError` if it is undetermined."""
        if self.origin is Origin.UNDETERMINED:
            raise ExportError(
                f"{self.name} was not determined, and {by} needs it: {self.why}. Record more "
                "orientations or a second payload, or hold one of them with calibrate --hold"
            )
        return self.value

    @property
    def known(self) -> bool:
        """Whether the data determined this number, so that its origin is a fit."""
        return self.origin is Origin.IDENTIFIED

    def line(self) -> str:
        """Text of one line: value ± std [unit] and origin."""
        if self.origin is Origin.UNDETERMINED:
            return f"{self.name}: undetermined, {self.why}"
        std = self.std if self.std is not None else (None,) * len(self.value)
        parts = [
            f"{v:.6g}" + ("" if s is None else f" ± {s:.2g}")
            for v, s in zip(self.value, std, strict=True)
        ]
        origin = "" if self.origin is Origin.IDENTIFIED else f" ({self.origin})"
        return f"{self.name}: {', '.join(parts)} {self.unit}{origin}"


@dataclass(frozen=True, eq=False)
class LoadNumbers:
    """Numbers of a calibration on the load, the sensor and its place, for other programs.

    Attributes:
        source: name of the file, fit.json or twin.json.
        digest: SHA-256 of that file.
        robot, recording: names of the calibrated robot and of the recording.
        frame: in whose axes ``cog``, ``inertia``, ``rotation`` and ``position`` are: the flange's,
            or the sensor's where no flange is known.
        mass: mass of all that loads the gauges [kg].
        cog: centre of gravity of that mass in ``frame`` [m]; ``cog_sensor`` in sensor axes.
        inertia: about the CoG, axes of ``frame``, xx yy zz xy xz yz [kg·m²]; ``inertia_sensor``
            in sensor axes.
        rotation: rotation vector of the sensor in ``frame`` [rad].
        position: position of the sensor's origin in ``frame`` [m].
        bias: zero of the sensor, six channels [N, N·m].
        gravity: gravity in axes of the robot's base [m/s²].
        left: lines on what the file knows and no format here carries.
        twin: the calibrated simulator with these numbers.
    """

    source: str
    digest: str
    robot: str
    recording: str
    frame: str
    mass: Quantity
    cog: Quantity
    cog_sensor: Quantity
    inertia: Quantity
    inertia_sensor: Quantity
    rotation: Quantity
    position: Quantity
    bias: Quantity
    gravity: Quantity
    left: tuple[str, ...]
    twin: Twin


class _Calibrated(NamedTuple):
    """A calibrated simulator with parameters θ (effects are parameters where possible): indices of
    the K identified ones, their covariance (K, K) if known, index → name of parameters of which the
    data fix only a combination, and lines on what no format carries."""

    twin: Twin
    free: tuple[int, ...]
    covariance: np.ndarray | None
    blind: Mapping[int, str]
    left: tuple[str, ...]


def load_numbers(path: str | Path, mount: Sequence[float] | None = None) -> LoadNumbers:
    """Read the numbers for other programs from fit.json or twin.json.

    ``mount``: pose of the sensor in the flange, x y z [m] qw qx qy qz, for a robot whose model has
    no flange; the numbers are then in flange axes.

    Raises:
        ExportError: it is neither, its data refute it, it did not converge, or ``mount`` is wrong
            or not needed; names the file and the field.
    """
    fields = checked.Fields(checked.load(path, ExportError), f"{path}: ", ExportError)
    known = _of_fit(fields) if "parameters" in fields.raw else _of_twin(path)
    model, theta = known.twin.model, known.twin.theta
    flange = "mount.position.x" in model.parameters.names
    if flange and mount is not None:
        raise ExportError(f"--mount: {path} knows the place of the sensor in the flange")
    stated = None if mount is None else _mount(mount)
    slopes = [_load_of(model, shifted[0], stated) for shifted in complex_steps(theta, known.free)]
    quantities = {
        name: _quantity(known, name, value, np.array([s[name].imag / STEP for s in slopes]))
        for name, value in _load_of(model, theta, stated).items()
    }
    for name in ("cog", "inertia"):  # a turned number is identified if the number itself is
        in_sensor, turned = quantities[f"{name}_sensor"], quantities[name]
        if turned.known and not in_sensor.known:
            quantities[name] = replace(turned, std=None, origin=in_sensor.origin, why=in_sensor.why)
    return LoadNumbers(
        source=Path(path).name,
        digest=hashlib.sha256(Path(path).read_bytes()).hexdigest(),
        robot=str(fields.raw.get("robot")),
        recording=str(fields.raw.get("recording")),
        frame=SENSOR if stated is None and not flange else FLANGE,
        left=known.left,
        twin=known.twin,
        **quantities,
    )


def calibrated_twin(path: str | Path) -> Twin:
    """Make the twin (calibrated simulator) that fit.json or twin.json states. An `ExportError` or
    `TwinError`, which names the file and the field, if it is neither, or cannot be trusted."""
    raw = checked.load(path, ExportError)
    if not isinstance(raw, dict) or "parameters" not in raw:
        return Twin.read(path)
    if raw.get("channels") != "pose":
        return load_numbers(path).twin
    _trusted(checked.Fields(raw, f"{path}: ", ExportError))
    return Twin.from_json({k: v for k, v in raw.items() if k in _OF_TWIN}, str(path))


def _trusted(fields: checked.Fields) -> None:
    """Raise `ExportError` for a fit that its own data refute, or that did not converge."""
    if refuted := fields.raw.get("refuted"):
        raise ExportError(f"{fields.where}its own data refute it: {refuted}")
    if fields.raw.get("converged") is not True:
        raise ExportError(f"{fields.where}converged is not true: such a fit is not exported")


def _load_of(model: Model, theta: np.ndarray, mount: tuple[Any, Any] | None) -> Vectors:
    value = dict(zip(model.parameters.names, theta, strict=True))
    phi = model.robot.tool(model.robot.robot_theta(theta)).inertial
    if not phi[0].real > 0.0:
        raise ExportError(f"the mass is {phi[0].real:g} kg: there is no load to export")
    mass, cog, inertia = about_centre(phi)
    vector, shift = (np.zeros(3), np.zeros(3)) if mount is None else mount
    if "mount.position.x" in value:
        vector = np.array([value[f"mount.rotation.{a}"] for a in "xyz"])
        shift = np.array([value[f"mount.position.{a}"] for a in "xyz"])
    turn = exp(*vector)
    tilt = exp(value.get("base.tilt.x", 0.0), value.get("base.tilt.y", 0.0), 0.0)
    return {
        "mass": np.array([mass]), "cog": shift + turn @ cog, "cog_sensor": cog,
        "inertia": six_of(turn @ inertia @ turn.T), "inertia_sensor": six_of(inertia),
        "rotation": vector, "position": shift, "bias": np.array([value[n] for n in _BIAS]),
        "gravity": tilt @ np.asarray(model.gravity),
    }  # fmt: skip


def _quantity(known: _Calibrated, name: str, value: np.ndarray, slope: np.ndarray) -> Quantity:
    """Quantity ``name`` of values (V,), with derivatives (K, V) by the K identified parameters."""
    moved = [i for i, s in zip(known.free, slope, strict=True) if np.abs(s).max() > _FLAT]
    title, unit = _TITLES[name]
    if blind := [known.blind[i] for i in moved if i in known.blind]:
        why = "; ".join(sorted(set(blind)))
        return Quantity(title, value, None, unit, Origin.UNDETERMINED, why)
    if not moved:
        return Quantity(title, value, None, unit, Origin.STATED)
    std = None
    if known.covariance is not None:
        std = np.sqrt(np.einsum("ik,ij,jk->k", slope, known.covariance, slope))
    return Quantity(title, value, std, unit, Origin.IDENTIFIED)


def _mount(mount: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Split ``mount`` (x y z qw qx qy qz) into rotation vector (3,) [rad] and origin (3,) [m]."""
    values = np.asarray(mount, dtype=float)
    norm = float(np.linalg.norm(values[3:])) if values.shape == (7,) else 0.0
    if not np.isfinite(values).all() or abs(norm - 1.0) > _UNIT:
        raise ExportError(
            "--mount: give x y z [m] qw qx qy qz of the sensor in the flange, a unit quaternion"
        )
    return Rotation.from_quat(values[[4, 5, 6, 3]]).as_rotvec(), values[:3]


def _of_fit(fields: checked.Fields) -> _Calibrated:
    where, raw = fields.where, fields.raw
    what = _NO_LOAD.get(str(raw.get("channels")))
    if what is not None:
        raise ExportError(f"{where}is a fit of {what}: a load is exported from a fit of the wrench")
    _trusted(fields)
    names, robot = fields.part("theta").raw, ORIENTED
    if set(names) != set(Model.of(ORIENTED).parameters.names):
        with fields.naming("robot"):
            robot = registry.load("robots", known_name(raw, str(raw.get("robot"))))
    gravity = fields.numbers("gravity", 3, rule="must be 3 numbers [m/s²]")
    model = Model(robot, gravity or tuple(robot.gravity))
    with fields.naming("theta"):
        theta = model.parameters.vector(names)
    parameters = fields.part("parameters")
    with fields.naming("parameters"):
        free = tuple(model.parameters.index(name) for name in parameters.raw)
    covariance = np.array(fields.square("covariance", len(free)))
    sentences = [str(part.raw.get("sentence")) for part in fields.parts("redundancies")]
    alike = "; ".join(sentences) or "of these the data fix only combinations"
    blind, others = dict[int, str](), list[str]()
    for i, (name, entry) in zip(free, parameters.raw.items(), strict=True):
        if parameters.part(name).number("std", "") is None:
            blind[i] = f"{name}: {alike}"
        if name not in robot.load and not name.startswith(_CARRIED):
            value, unit = entry.get("value"), entry.get("unit")
            others.append(f"{name} = {value:.6g} {unit}" if checked.is_number(value) else name)
    twin = Twin(model, theta, (), fields.text("recording"))
    return _Calibrated(twin, free, covariance, blind, tuple(others))


def _of_twin(path: str | Path) -> _Calibrated:
    twin = Twin.read(path)
    robot, theta, omitted = twin.model.robot, twin.theta.copy(), []
    for a in twin.active:
        changed = a.effect.as_parameters(robot, theta[: len(robot.parameters)], a.values)
        if changed is None:
            values = ", ".join(f"{k} = {v:.4g}" for k, v in a.values.items())
            omitted.append(f"{a.effect.name}: {values}")
        else:
            theta[: len(robot.parameters)] = changed
    nominal = twin.model.parameters.nominal
    free = tuple(int(i) for i in np.flatnonzero(theta != nominal))
    plain = Twin(twin.model, theta, (), twin.recording)
    return _Calibrated(plain, free, None, {}, tuple(omitted))
