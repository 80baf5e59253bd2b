"""``docs/reference/effects.md``: every effect of the registry, written by `scripts/effects`."""

import inspect
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from wrenchbed import registry
from wrenchbed.diagnosis.explain.verdict import INSEPARABLE
from wrenchbed.effects.base import STAGES, Effect
from wrenchbed.effects.chain import effects
from wrenchbed.effects.scene import examples
from wrenchbed.errors import NotFoundError
from wrenchbed.physics.parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot

SEEN = "Seen in: "
"""Begins the paragraph of an effect's docstring that says which data show it."""
PAGE = Path(__file__).resolve().parents[3] / "docs" / "reference" / "effects.md"
_FIRST = "## All effects"
"""Heading at which what is written by hand ends."""
_MODES = {"static": "at rest", "dynamic": "in motion"}
_MOST_NAMES = 3
"""Parameters of one meaning that are listed; of more the first and the last."""


def render() -> str:
    """The page as Markdown: its introduction as it stands in the clone, then every effect."""
    known = effects()
    introduction, _, _ = PAGE.read_text(encoding="utf-8").partition(_FIRST)
    overview = [f"{_FIRST}\n\n| effect | what happens | stage | recordings |\n|---|---|---|---|"]
    overview += [
        f"| [`{name}`](#{name.replace('.', '')}) | {e.title} | {e.stage} | {_recordings(e)} |"
        for name, e in known.items()
    ]
    parts = [introduction.rstrip("\n") + "\n", *overview, ""]
    robots = {n: registry.load("robots", n) for n in registry.names("robots")}
    for subsystem in dict.fromkeys(e.subsystem for e in known.values()):
        parts.append(f"## {subsystem}\n")
        parts += [_section(e, robots) for e in known.values() if e.subsystem == subsystem]
    return "\n".join(parts).rstrip() + "\n"


def _section(e: Effect, known: dict[str, Robot]) -> str:
    """Heading, formula, properties and parameters of an effect."""
    robots = {n: robot for n, robot in known.items() if e.applies(robot)}
    who = _all_or(robots, known)
    rows = [
        f"### {e.name}\n",
        f"{e.title[0].upper()}{e.title[1:]}. {' '.join(_paragraphs(e)[0].split())}\n",
        f"- stage: {e.stage}; recordings: {_recordings(e)}; robots: {who}",
        f"- seen in: {seen_in(e)}",
        f"- in MuJoCo: {_in_mujoco(e)}",
        f"- size from: {e.source}",
    ]
    if e.shown != "prediction":
        rows.append(f"- drawn over: {e.shown}")
    if not e.between_rows:
        rows.append(f"- may miss: {100 * e.form_error:g} %")
    others = sorted(n for pair in INSEPARABLE if e.name in pair for n in pair - {e.name})
    if others:
        rows.append("- companions: " + ", ".join(f"`{n}`" for n in others))
    rows += ["", "| parameter | meaning | kind | size | robots |", "|---|---|---|---|---|"]
    return "\n".join([*rows, *_parameters(e, robots)]) + "\n"


def seen_in(e: Effect) -> str:
    """Which recordings show an effect: the paragraph ``Seen in: …`` of its docstring, in one line.

    Raises:
        NotFoundError: the docstring has no such paragraph.
    """
    for text in _paragraphs(e):
        if text.startswith(SEEN):
            return " ".join(text.removeprefix(SEEN).split()).rstrip(".")
    raise NotFoundError(f"effect {e.name}: its docstring has no paragraph {SEEN.strip()!r}")


def _paragraphs(e: Effect) -> list[str]:
    return (inspect.getdoc(type(e)) or "").replace("``", "`").split("\n\n")


def _recordings(e: Effect) -> str:
    return ", ".join(_MODES[m] for m in e.modes)


def _all_or(some: dict[str, Robot] | list[str], known: dict[str, Robot]) -> str:
    return "all" if len(some) == len(known) else ", ".join(some)


def _in_mujoco(e: Effect) -> str:
    if type(e).edit_spec is not Effect.edit_spec:
        sentence = (inspect.getdoc(type(e).edit_spec) or "").split("\n")[0]
        return f"{sentence[0].lower()}{sentence[1:].rstrip('.')}"
    return STAGES[e.stage].simulated


def _parameters(e: Effect, robots: dict[str, Robot]) -> Iterator[str]:
    """One row for parameters that differ in their number or channel alone."""
    rows: dict[tuple[str, ...], list[str]] = {}
    free = {n for robot in robots.values() for n in _amplitudes(e, robot)}
    for robot_name, robot in robots.items():
        groups: dict[tuple[str, ...], list[str]] = {}
        for p in e.parameters(robot):
            kind = "amplitude" if p.name in free else "shape"
            groups.setdefault((_stem(p.name), _text(p), kind, _size(p)), []).append(p.name)
        for (_, *cells), names in groups.items():
            rows.setdefault((_listed(names), *cells), []).append(robot_name)
    for row, who in rows.items():
        yield f"| {' | '.join(row)} | {_all_or(who, robots)} |"


def _amplitudes(e: Effect, robot: Robot) -> set[str]:
    if e.between_rows:
        return {p.name for p in e.parameters(robot) if p.nominal == 0.0}
    return {n for s in examples(robot) for v in e.variants(s) for n in v.free}


def _stem(name: str) -> str:
    first, *rest = name.split(".")
    channels = rest and all(r in CHANNELS for r in rest)
    return first if channels else name.rpartition(".")[0]


def _text(p: Parameter) -> str:
    """The text with channels as what they are, where the name is of two of them."""
    text = p.text.replace("|", "\\|")
    pair = [part for part in p.name.split(".") if part in CHANNELS]
    for channel in pair if len(pair) > 1 else ():
        text = text.replace(channel, "a force" if channel[0] == "f" else "a torque")
    return text


def _listed(names: list[str]) -> str:
    if len(names) <= _MOST_NAMES:
        return ", ".join(f"`{n}`" for n in names)
    return f"`{names[0]}` … `{names[-1]}`"


def _size(p: Parameter) -> str:
    unit = "" if p.unit == "1" else f" {p.unit}"
    degrees = f" ({np.rad2deg(p.tolerance):.2g}°)" if p.unit == "rad" else ""
    return f"{p.tolerance:.3g}{unit}{degrees}"
