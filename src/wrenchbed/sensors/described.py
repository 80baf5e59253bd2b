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
"""Of the SHA-256 in a sensor's name."""
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
    """A sensor of this package, by its plain name.

    Raises:
        ParameterError: names the file, the field, its value and what is allowed.
    """
    return _sensor(path.read_text(encoding="utf-8"), str(path))


def read(path: Path) -> Sensor:
    """The sensor of a user's TOML file.

    Raises:
        ParameterError: names the file, the field, its value and what is allowed.
        NotFoundError: there is no such file.
    """
    return _own(text_of(path, NotFoundError), str(path))


def rebuilt(record: Mapping[str, Any]) -> Sensor:
    """The sensor of what a recording carries, see `Sensor.record`.

    Raises:
        ParameterError: it is incomplete.
    """
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
        top.refuse("format", f"must be {FORMAT}")
    name = top.stated_text("name")
    if "@" in name or name.lower().endswith(".toml"):
        top.refuse("name", "must hold no '@' and not end in .toml")
    rows = top.raw.get("calibration")
    if not isinstance(rows, list) or not rows:
        top.refuse("calibration", "must be one or more [[calibration]] tables")
    calibrations = tuple(
        _calibration(Fields(row, f"{where}: ", ParameterError, f"calibration {k}"))
        for k, row in enumerate(rows, 1)
    )
    known = [c.name for c in calibrations]
    default = top.stated_text("default")
    if default not in known:
        hint = did_you_mean(default, known)
        top.refuse("default", f"is none of its calibrations{hint}: {', '.join(known)}")
    full = calibrations[known.index(default)]
    mass, offset = top.part("mass").only(_VALUE), top.part("plate_offset").only(_VALUE)
    noise = top.part("noise").only(_NOISE)
    more: dict[str, Any] = {}
    for key in {"counts", "accuracy"} & top.raw.keys():
        stated = top.part(key).only(_VALUE)
        more |= {key: _positive(stated, "value"), f"{key}_source": stated.stated_text("source")}
    if "gauges" in top.raw:
        gauges = top.part("gauges").only(("matrix", "source"))
        more |= {"gauges": _matrix(gauges, "matrix"), "gauges_source": gauges.stated_text("source")}
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
        row.refuse("resolution", f"must be below range = {row.raw['range']}")
    return SensorCalibration(row.stated_text("name"), full, step, row.stated_text("source"))


def _noise(table: Fields, calibration: SensorCalibration) -> NoiseModel:
    """Noise of the default calibration."""
    full = calibration.range
    parts: dict[str, Any] = {}
    for key in _VECTORS:
        signed = key == "warmup_drift"
        value = np.array(table.stated_numbers(key, 6, _WRENCH))
        if not signed and (value < 0.0).any():
            table.refuse(key, "must not be below 0")
        if not (np.abs(value) < full).all():
            rule = f"must be below the range {full.tolist()} of {calibration.name}"
            table.refuse(key, f"{rule} in every channel (is it mN?)")
        parts["resolution" if key == "step" else key] = value
    parts |= {key: table.amount(key, unit) for key, unit in _SCALARS.items()}
    if "correlation" in table.raw:
        parts["correlation"] = _matrix(table, "correlation")
    try:
        return NoiseModel(**parts, range=full)
    except ParameterError as cause:
        raise ParameterError(f"{table.where}{cause}") from None


def _positive(table: Fields, key: str) -> Array:
    """Six numbers above 0."""
    value = np.array(table.stated_numbers(key, 6, _WRENCH))
    if not (value > 0.0).all():
        table.refuse(key, "must be above 0 in every channel")
    return value


def _matrix(table: Fields, key: str) -> Array:
    """Six rows of six numbers."""
    rows = table.raw.get(key)
    rule = "must be six rows of six numbers"
    if not isinstance(rows, list) or len(rows) != 6:
        table.refuse(key, rule)
    each = (Fields({key: row}, table.where, ParameterError, table.name) for row in rows)
    return np.array([row.stated_numbers(key, 6, rule) for row in each])


def text(sensor: Sensor, notes: tuple[str, ...] = ()) -> str:
    """The TOML of a sensor; ``notes`` are comments at its beginning."""
    noise = sensor.noise
    lines = [
        *(f"# {note}".rstrip() for note in notes),
        f"format = {FORMAT}",
        f"name = {quoted(sensor.name.partition('@')[0])}",
        f"title = {quoted(sensor.title)}",
        f"default = {quoted(sensor.default)}  # the calibration that the noise belongs to",
    ]
    for c in sensor.calibrations:
        lines += [
            "",
            "[[calibration]]  # fx fy fz tx ty tz [N, N·m]",
            f"name = {quoted(c.name)}",
            f"range = {listed(c.range)}",
            f"resolution = {listed(c.resolution)}",
            f"source = {quoted(c.source)}",
        ]
    lines += _table("mass", "kg", repr(float(sensor.mass)), sensor.mass_source)
    face = "from the face on the robot's side to the origin of the wrench, sensor axes [m]"
    lines += _table("plate_offset", face, listed(sensor.plate_offset), sensor.plate_offset_source)
    if sensor.counts is not None:
        unit = "of the digital output, per N and N·m"
        lines += _table("counts", unit, listed(sensor.counts), sensor.counts_source)
    if sensor.accuracy is not None:
        lines += _table("accuracy", "± [N, N·m]", listed(sensor.accuracy), sensor.accuracy_source)
    if sensor.gauges is not None:
        lines += ["", "[gauges]  # matrix from gauge voltages [V] to the wrench [N, N·m]"]
        lines += ["matrix = [", *(f"  {listed(row)}," for row in sensor.gauges), "]"]
        lines += [f"source = {quoted(sensor.gauges_source)}"]
    lines += [
        "",
        "[noise]  # of one row at rest [N, N·m]",
        f"white = {listed(noise.white)}",
        f"flicker = {listed(noise.flicker)}  # 1/f: root of the density at 1 Hz",
        f"f_low = {noise.f_low!r}  # Hz, ends of the 1/f part",
        f"f_high = {noise.f_high!r}",
    ]
    if not np.array_equal(noise.correlation, np.eye(6)):
        lines += ["correlation = [", *(f"  {listed(row)}," for row in noise.correlation), "]"]
    lines += [
        f"mains_amplitude = {listed(noise.mains_amplitude)}",
        f"mains_frequency = {noise.mains_frequency!r}  # Hz",
        f"warmup_drift = {listed(noise.warmup_drift)}  # complete, from power-up on",
        f"warmup_time = {noise.warmup_time!r}  # s",
        f"warmup_age = {noise.warmup_age!r}  # s since power-up at the first row",
        f"step = {listed(noise.resolution)}  # of the output words; 0 does not round",
        f"source = {quoted(sensor.noise_source)}",
        "",
    ]
    return "\n".join(lines)


def _table(name: str, unit: str, value: str, source: str) -> list[str]:
    return ["", f"[{name}]  # {unit}", f"value = {value}", f"source = {quoted(source)}"]
