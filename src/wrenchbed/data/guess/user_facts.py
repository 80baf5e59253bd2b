"""Facts that a user knows besides the files, written into the map that is guessed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.data.column_map import UNITS
from wrenchbed.data.guess.column_readings import wrenches
from wrenchbed.data.guess.column_roles import Sheet, sheet_of
from wrenchbed.data.guess.convention import Convention, GravityFit, in_body
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import MapError
from wrenchbed.files.checked import Fields, load
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.wrench import CHANNELS

_STANDARD = 9.80665
_UNTOUCHED, _NORMAL = 0.3, 0.3853
"""Least fraction of rows free of contact, and that quantile of |x| for a standard normal x."""
_SIGMAS = 3.0
"""Tolerances of a map, in standard uncertainties of the earlier calibration."""
_ZERO_FREE = 2.0
"""Tolerance of the zero of a sensor that nobody zeroed, over its largest reading."""


@dataclass(frozen=True)
class Stated:
    """Facts about robot, tool and sensor that are known besides the files.

    Attributes:
        robot: With --guess: name of the robot.
        gravity: With --guess: size of gravity [m/s²].
        tool_mass: With --guess: known mass of the tool [kg], which tells units apart.
        sensor: With --guess: model, see `wrenchbed list sensors`, or a sensor's TOML file.
        fit: With --guess: fit.json of the same sensor and tool; states tool, zeros and tolerances.
        rest: With --guess: text file of the wrench at rest; states the noise of one row.
    """

    robot: str | None = None
    gravity: float | None = None
    tool_mass: float | None = None
    sensor: str | None = None
    fit: Path | None = None
    rest: Path | None = None

    def gravity_size(self, tables: Sequence[Sheet] = ()) -> float:
        """Gravity's magnitude [m/s²]: as stated, else from columns gx gy gz, else standard."""
        if self.gravity is not None:
            return self.gravity
        for sheet in tables:
            if "gx" in sheet.roles:
                g = np.linalg.norm(sheet.block([sheet.roles[f"g{a}"] for a in "xyz"]), axis=1)
                if np.ptp(g) < 0.01 * g.mean() and 9.7 < g.mean() < 9.9:
                    return round(float(g.mean()), 6)
        return _STANDARD

    @cached_property
    def known(self) -> "KnownLoad | None":
        """Load from the earlier calibration in ``fit``, None without one."""
        return None if self.fit is None else KnownLoad.read(self.fit)

    @property
    def mass(self) -> float | None:
        """Known mass of the tool [kg], stated or from an earlier calibration; None if unknown."""
        calibrated = None if self.known is None else self.known.mass
        return calibrated if self.tool_mass is None else self.tool_mass

    def put(
        self,
        recording: dict[str, Any],
        wrench: dict[str, dict[str, Any]],
        sheet: Sheet,
        in_base: bool,
    ) -> None:
        """Write these facts to a map's ``[recording]`` and to its entries ``wrench`` of the six
        channels; ``sheet`` has the wrench, whose largest values bound the zeros: of each channel,
        or if it is ``in_base`` axes, of three. A `MapError` if the fit or the rows at rest cannot
        be read."""
        sensor: dict[str, Any] = {} if self.sensor is None else {"model": self.sensor}
        if self.rest is not None:
            sensor["noise_std"] = _noise(self.rest, wrench)
        if sensor:
            recording["sensor"] = recording.get("sensor", {}) | sensor
        if self.known is not None:
            self.known.put(recording, wrench, self.gravity_size())
            return
        if self.tool_mass is not None:
            recording["tool"] = {"mass": self.tool_mass}
        entries = [wrench[channel] for channel in CHANNELS]
        largest = [sheet.largest[e["column"]] * UNITS[e["unit"]][1] for e in entries]
        if in_base:
            largest = [max(three) for three in (largest[:3], largest[3:]) for _ in range(3)]
        zeros = [float(f"{_ZERO_FREE * size:.2g}") or 1.0 for size in largest]
        recording["tolerance"] = {"sensor.bias": zeros}


NOTHING = Stated()
"""Facts of a user who knows nothing besides the files."""


@dataclass(frozen=True, eq=False)
class KnownLoad:
    """Load and zeros from an earlier calibration.

    Attributes:
        mass: mass [kg].
        cog: centre of gravity in sensor axes (3,) [m].
        bias: zero readings of the sensor (6,) [N, N·m].
        std: standard uncertainty of each parameter by its name; 0 where the fit has none.
        force_rms: largest residual of a force channel in that fit [N].
    """

    mass: float
    cog: tuple[float, ...]
    bias: np.ndarray
    std: Mapping[str, float]
    force_rms: float

    @classmethod
    def read(cls, path: Path) -> "KnownLoad":
        """Read the load from a calibration's ``fit.json``; a `MapError` without tool or sensor
        bias."""
        raw = Fields(load(path, MapError), f"{path}: ", MapError)
        tool, values = raw.part("tool"), raw.part("parameters")
        mass, cog = tool.number("mass", "kg", positive=True), tool.numbers("cog", 3)
        bias = [values.part(f"sensor.bias.{c}").number("value", "SI") for c in CHANNELS]
        if mass is None or cog is None or None in bias:
            raise MapError(f"{path}: is no fit.json with tool and sensor.bias.fx … tz")
        std = {k: v.get("std") for k, v in values.raw.items() if isinstance(v, Mapping)}
        known = {k: float(s) for k, s in std.items() if isinstance(s, int | float) and s > 0}
        rms = [raw.part("residual_rms").number(c, "N") or 0.0 for c in CHANNELS[:3]]
        return cls(mass, cog, np.array(bias, dtype=float), known, max(rms))

    def fitted(self, c: Convention, gravity: float) -> GravityFit:
        """Fit of this load, instead of the one fitted, to convention c under ``gravity`` [m/s²].
        Its rms residuals are of the better rows, so that a hand on the tool for a while does not
        matter."""
        fit, turn, wrench = c.fit, c.turn, c.poses.mean(c.pairing.readings)
        if c.in_base:
            wrench = in_body(turn, wrench)
        m = np.eye(3) if fit.mount is None else fit.mount.as_matrix()
        down, cog = turn[:, fit.axis, :] @ m.T, np.asarray(self.cog)

        def with_weight(weight: float) -> GravityFit:
            force = weight * down
            error = np.abs(wrench - self.bias - np.hstack([force, cross(cog, force)]))
            usual = np.quantile(error, _UNTOUCHED, axis=0) / _NORMAL
            rms = [max(float(np.sqrt((p**2).mean())), 1e-9) for p in np.split(usual, 2)]
            return replace(
                fit, weight=weight, lever=cog, force_rms=rms[0], torque_rms=rms[1],
                share=rms[0] / abs(weight),
            )  # fmt: skip

        weight = self.mass * gravity
        return min(map(with_weight, (weight, -weight)), key=lambda f: f.force_rms)

    def put(
        self, recording: dict[str, Any], wrench: Mapping[str, dict[str, Any]], gravity: float
    ) -> None:
        """Write tool, zeros and tolerances to a map's ``[recording]`` and its entries ``wrench`` of
        the six channels. The mass's tolerance is at least the fit's rms force residual /
        ``gravity`` [m/s²]."""
        recording["tool"] = {"mass": round(self.mass, 6), "cog": [round(x, 6) for x in self.cog]}
        for channel, bias in zip(CHANNELS, self.bias, strict=True):
            entry = wrench[channel]
            size = UNITS[entry["unit"]][1] * entry.get("sign", 1)
            entry["zero"] = float(f"{bias / size:.6g}")

        def sigmas(stem: str, ends: Sequence[str]) -> list[float]:
            return [float(f"{_SIGMAS * self.std.get(stem + end, 0.0):.3g}") for end in ends]

        tolerance: dict[str, Any] = {
            "tool.mass": max(*sigmas("tool.mass", [""]), float(f"{self.force_rms / gravity:.3g}")),
            "tool.cog": max(sigmas("tool.cog.", "xyz")),
            "sensor.bias": sigmas("sensor.bias.", CHANNELS),
        }
        recording["tolerance"] = {k: v for k, v in tolerance.items() if np.min(v) > 0}


def _noise(rest: Path, wrench: Mapping[str, Mapping[str, Any]]) -> list[float]:
    """Standard deviation (6,) [N, N·m] of a row of the file ``rest``, in units of ``wrench``."""
    sheet = sheet_of(read_text(rest))
    columns = next(wrenches(sheet), None)
    if columns is None:
        raise MapError(f"{rest}: no six columns that might be a wrench")
    stds = {
        c: sheet.values[n].std(ddof=1) * UNITS[wrench[c]["unit"]][1] for c, n in columns.items()
    }
    return [float(f"{std:.3g}") for std in stds.values()]
