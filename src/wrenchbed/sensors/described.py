"""A sensor as a TOML file: those of this package, and those of users.

`shipped` and `read` check a file, `rebuilt` makes the same sensor from what a recording carries,
and `text` writes one. SI units everywhere; six numbers are fx fy fz tx ty tz. Every table that
holds numbers states its ``source``. The name of a user's sensor is that in the TOML, ``@`` and the
beginning of the text's SHA-256, so that two files never pass for one.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.errors import NotFoundError, ParameterError, did_you_mean
from wrenchbed.files.checked import Fields, listed, quoted, text_of, toml_fields
from wrenchbed.physics.noise import Array, NoiseModel
from wrenchbed.sensors.base import Sensor, SensorCalibration

FORMAT = 1
_DIGITS = 8
"""Digits of the SHA-256 in a sensor's name."""
_HEAVIEST, _FARTHEST = 20.0, 0.5
"""Largest mass [kg] and plate offset [m]: they exclude numbers in g and mm."""
_TOP = ("format", "name", "title", "default", "mass", "plate_offset", "counts", "calibration",
        "noise", "accuracy", "gauges")  # fmt: skip
_VALUE = ("value", "source")
_CALIBRATION = ("name", "range", "resolution", "source")
_VECTORS = ("white", "flicker", "mains_amplitude", "warmup_drift", "step")
_SCALARS = {"f_low": "Hz", "f_high": "Hz", "mains_frequency": "Hz", "warmup_time": "s",
            "warmup_age": "s"}  # fmt: skip
_NOISE = (*_VECTORS, *_SCALARS, "correlation", "source")
_WRENCH = "must be six numbers fx fy fz tx ty tz in N and N·m, without units"


def shipped(path: Path) -> Sensor:
    """Read the TOML file of a sensor of this package; its name gets no hash. A `ParameterError`
    names the file, the field, its value and what is allowed."""
    return _sensor(path.read_text(encoding="utf-8"), str(path))


def read(path: Path) -> Sensor:
    """Read the TOML file of a user's sensor. Raises a `ParameterError` as `shipped`, and a
    `NotFoundError` if there is no such file."""
    return _own(text_of(path, NotFoundError), str(path))


def rebuilt(record: Mapping[str, Any]) -> Sensor:
    """Make a user's sensor from the `Sensor.record` that a recording carries, with its TOML text; a
    `ParameterError` if that is incomplete."""
    text = record.get("toml")
    if not isinstance(text, str):
        raise ParameterError("sensor_model: incomplete: 'toml' must be the text of the sensor")
    return _own(text, "sensor_model")


def _own(text: str, where: str) -> Sensor:
    sensor = _sensor(text, where)
    digest = hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
    return replace(sensor, name=f"{sensor.name}@{digest}", record={"toml": text})


def _sensor(text: str, where: str) -> Sensor:
    top = toml_fields(text, where, ParameterError).only(_TOP)
    if top.raw.get("format") != FORMAT:
        raise top.error("format", f"must be {FORMAT}")
    name = top.stated_text("name")
    if "@" in name or name.lower().endswith(".toml"):
        raise top.error("name", "must hold no '@' and not end in .toml")
    rows = top.raw.get("calibration")
    if not isinstance(rows, list) or not rows:
        raise top.error("calibration", "must be one or more [[calibration]] tables")
    calibrations = tuple(
        _calibration(Fields(row, f"{where}: ", ParameterError, f"calibration {k}"))
        for k, row in enumerate(rows, 1)
    )
    known = [c.name for c in calibrations]
    default = top.stated_text("default")
    if default not in known:
        hint = did_you_mean(default, known)
        raise top.error("default", f"is none of its calibrations{hint}: {', '.join(known)}")
    full = calibrations[known.index(default)]
    mass, offset = top.part("mass").only(_VALUE), top.part("plate_offset").only(_VALUE)
    noise = top.part("noise").only(_NOISE)
    more: dict[str, Any] = {}
    for key in {"counts", "accuracy"} & top.raw.keys():
        stated = top.part(key).only(_VALUE)
        more |= {key: _positive(stated, "value"), f"{key}_source": stated.stated_text("source")}
    if "gauges" in top.raw:
        gauges = top.part("gauges").only(("matrix", "source"))
        more["gauges"] = np.array(gauges.square("matrix", 6))
        more["gauges_source"] = gauges.stated_text("source")
    x, y, z = offset.stated_numbers("value", 3, "must be three lengths in m", _FARTHEST, "mm")
    return Sensor(
        name=name, title=top.stated_text("title"), calibrations=calibrations, default=default,
        mass=mass.amount("value", "kg", _HEAVIEST, "g"), mass_source=mass.stated_text("source"),
        plate_offset=(x, y, z), plate_offset_source=offset.stated_text("source"),
        noise=_noise(noise, full), noise_source=noise.stated_text("source"), **more,
    )  # fmt: skip


def _calibration(row: Fields) -> SensorCalibration:
    row.only(_CALIBRATION)
    full, step = _positive(row, "range"), _positive(row, "resolution")
    if not (step < full).all():
        raise row.error("resolution", f"must be below range = {row.raw['range']}")
    return SensorCalibration(row.stated_text("name"), full, step, row.stated_text("source"))


def _noise(table: Fields, calibration: SensorCalibration) -> NoiseModel:
    """Read the noise of the default calibration from a TOML file's table ``[noise]``."""
    full = calibration.range
    parts: dict[str, Any] = {}
    for key in _VECTORS:
        signed = key == "warmup_drift"
        value = np.array(table.stated_numbers(key, 6, _WRENCH))
        if not signed and (value < 0.0).any():
            raise table.error(key, "must not be below 0")
        if not (np.abs(value) < full).all():
            rule = f"must be below the range {full.tolist()} of {calibration.name}"
            raise table.error(key, f"{rule} in every channel (is it mN?)")
        parts["resolution" if key == "step" else key] = value
    parts |= {key: table.amount(key, unit) for key, unit in _SCALARS.items()}
    if "correlation" in table.raw:
        parts["correlation"] = np.array(table.square("correlation", 6))
    try:
        return NoiseModel(**parts, range=full)
    except ParameterError as cause:
        raise ParameterError(f"{table.where}{cause}") from None


def _positive(table: Fields, key: str) -> Array:
    """Read six numbers above 0 of a table's key, as an array (6,)."""
    value = np.array(table.stated_numbers(key, 6, _WRENCH))
    if not (value > 0.0).all():
        raise table.error(key, "must be above 0 in every channel")
    return value


def text(sensor: Sensor, notes: tuple[str, ...] = ()) -> str:
    """TOML text of a sensor's file; ``notes`` are comments at its beginning."""
    noise, lines = sensor.noise, [f"# {note}".rstrip() for note in notes]
    top = {"name": sensor.name.partition("@")[0], "title": sensor.title, "default": sensor.default}
    lines += [f"format = {FORMAT}", *(f"{key} = {quoted(value)}" for key, value in top.items())]
    lines[-1] += "  # the calibration that the noise belongs to"
    for c in sensor.calibrations:
        values = {"range": listed(c.range), "resolution": listed(c.resolution)}
        title = "[[calibration]]  # fx fy fz tx ty tz [N, N·m]"
        lines += ["", title, f"name = {quoted(c.name)}", *_lines(values, c.source)]
    face = "from the face on the robot's side to the origin of the wrench, sensor axes [m]"
    volts = "matrix from gauge voltages [V] to the wrench [N, N·m]"
    tables = [
        ("mass", "kg", repr(float(sensor.mass))),
        ("plate_offset", face, listed(sensor.plate_offset)),
        ("counts", "of the digital output, per N and N·m", _numbers(sensor.counts)),
        ("accuracy", "± [N, N·m]", _numbers(sensor.accuracy)),
        ("gauges", volts, _numbers(sensor.gauges)),
    ]
    for name, comment, value in tables:
        if value:
            key, source = "matrix" if name == "gauges" else "value", f"{name}_source"
            lines += ["", f"[{name}]  # {comment}", *_lines({key: value}, getattr(sensor, source))]
    numbers = {
        "white": listed(noise.white),
        "flicker": f"{listed(noise.flicker)}  # 1/f: root of the density at 1 Hz",
        "f_low": f"{noise.f_low!r}  # Hz, ends of the 1/f part",
        "f_high": repr(noise.f_high),
        "correlation": _numbers(noise.correlation),
        "mains_amplitude": listed(noise.mains_amplitude),
        "mains_frequency": f"{noise.mains_frequency!r}  # Hz",
        "warmup_drift": f"{listed(noise.warmup_drift)}  # complete, from power-up on",
        "warmup_time": f"{noise.warmup_time!r}  # s",
        "warmup_age": f"{noise.warmup_age!r}  # s since power-up at the first row",
        "step": f"{listed(noise.resolution)}  # of the output words; 0 does not round",
    }
    if np.array_equal(noise.correlation, np.eye(6)):
        del numbers["correlation"]
    lines += ["", "[noise]  # of one row at rest [N, N·m]", *_lines(numbers, sensor.noise_source)]
    return "\n".join([*lines, ""])


def _lines(values: Mapping[str, str], source: str) -> list[str]:
    return [*(f"{key} = {value}" for key, value in values.items()), f"source = {quoted(source)}"]


def _numbers(values: Array | None) -> str:
    """TOML text of an array (6,) or (6, 6); empty for None."""
    if values is None:
        return ""
    rows = [f"  {listed(row)}," for row in values] if values.ndim == 2 else []
    return "\n".join(["[", *rows, "]"]) if rows else listed(values)
