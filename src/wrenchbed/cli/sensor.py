"""``wrenchbed sensor``: a sensor's noise from a recording at rest."""

import math
from pathlib import Path

import tyro
from rich.table import Table

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.outputs import Kind
from wrenchbed.physics.wrench import CHANNELS

_PER_MINUTE = 60.0


def sensor(
    rest: tyro.conf.Positional[Path],
    /,
    out: Path,
    like: str | None = None,
    as_json: Json = False,
) -> None:
    """Learn a sensor's noise from a minute at rest; OUT then stands wherever a sensor's name does.

    White and 1/f part, correlation, mains line, drift and step of each channel, and what the
    recording cannot tell. OUT is a small TOML; it may be edited.

    Args:
        rest: Recording of one pose, a minute or more, nothing touches the tool.
        out: TOML file to write.
        like: Sensor (name or TOML file) that gives range, resolution and mass; default is what
            the recording states, else generic.
        as_json: Print the result as JSON.
    """
    given = Path(like) if like is not None and like.lower().endswith(".toml") else None
    console.check_out(out, Kind.SENSOR, rest, given)
    learned = wb.learn_sensor(wb.Recording.read(rest), name=out.stem, like=like)
    learned.write(out)
    console.answer(_result(learned, out), as_json, _table(learned, out))
    if not as_json:
        console.say("It cannot tell:")
        for sentence in learned.cannot_tell:
            console.say(f"  {sentence}")


def _result(learned: "wb.LearnedSensor", out: Path) -> dict[str, object]:
    noise = learned.sensor.noise
    return {
        "sensor": str(out), "like": learned.like, "rows": learned.rows, "rate_hz": learned.rate,
        "channels": {
            channel: {
                "white": float(noise.white[k]), "white_std": s.white_std,
                "flicker": s.flicker, "flicker_std": s.flicker_std if s.flicker else None,
                "flicker_most": s.flicker_most, "mains": float(noise.mains_amplitude[k]),
                "drift_per_s": float(learned.drift[k]),
                "drift_per_s_std": float(learned.drift_std[k]), "step": float(noise.resolution[k]),
            }
            for k, (channel, s) in enumerate(zip(CHANNELS, learned.spectra, strict=True))
        },
        "mains_hz": noise.mains_frequency if noise.mains_amplitude.any() else None,
        "correlation": noise.correlation.tolist(), "correlation_std": learned.correlation_std,
        "lines_hz": list(learned.lines), "cannot_tell": list(learned.cannot_tell),
    }  # fmt: skip


def _table(learned: "wb.LearnedSensor", out: Path) -> Table:
    noise = learned.sensor.noise
    title = f"{learned.seconds:.3g} s at {learned.rate:.4g} Hz → {out}  [mN, mN·m]"
    table = Table(box=None, padding=(0, 2, 0, 0), title=title, title_justify="left")
    mains = f"{noise.mains_frequency:.4g} Hz"
    for column in ("", "white", "1/f at 1 Hz", mains, "drift a minute", "step"):
        table.add_column(column, justify="left" if not column else "right")
    for k, (channel, s) in enumerate(zip(CHANNELS, learned.spectra, strict=True)):
        line, step = noise.mains_amplitude[k], noise.resolution[k]
        drift = _PER_MINUTE * learned.drift[k], _PER_MINUTE * learned.drift_std[k]
        table.add_row(
            channel, _sure(noise.white[k], s.white_std),
            _sure(s.flicker, s.flicker_std) if s.flicker else f"< {_milli(s.flicker_most)}",
            _sure(line, learned.mains_std[k]) if line else "none",
            _sure(*drift), _milli(step) if step else "none",
        )  # fmt: skip
    return table


def _milli(value: float) -> str:
    return f"{1e3 * value:.3g}"


def _sure(value: float, std: float) -> str:
    """In thousandths, to two digits of the uncertainty."""
    places = max(0, 1 - math.floor(math.log10(1e3 * std))) if std > 0.0 else 3
    return f"{1e3 * value:.{places}f} ± {1e3 * std:.{places}f}"
