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


def render() -> str:
    """The page as Markdown: its introduction as it stands in the clone, then every effect."""
    known = effects()
    introduction, _, _ = PAGE.read_text(encoding="utf-8").partition(_FIRST)
    parts = [introduction.rstrip("\n") + "\n", *_overview(known)]
    for subsystem in dict.fromkeys(e.subsystem for e in known.values()):
        parts.append(f"## {subsystem}\n")
        for effect in known.values():
            if effect.subsystem == subsystem:
                parts.append(_section(effect))
    return "\n".join(parts).rstrip() + "\n"


def _overview(known: dict[str, Effect]) -> Iterator[str]:
    yield f"{_FIRST}\n\n| effect | what happens | stage | recordings |\n|---|---|---|---|"
    for name, e in known.items():
        link = f"[`{name}`](#{name.replace('.', '')})"
        yield f"| {link} | {e.title} | {e.stage} | {_recordings(e)} |"
    yield ""


def _section(e: Effect) -> str:
    rows = [
        f"### {e.name}\n",
        _sentence(e) + "\n",
        f"- stage: {e.stage}; recordings: {_recordings(e)}; robots: {_robots(e)}",
        f"- seen in: {seen_in(e)}",
        f"- in MuJoCo: {_in_mujoco(e)}",
        f"- size from: {e.source}",
    ]
    if e.shown != "prediction":
        rows.append(f"- drawn over: {e.shown}")
    if not e.between_rows:
        rows.append(f"- may miss: {100 * e.form_error:g} %")
    pairs = [p for p in INSEPARABLE if e.name in p]
    if pairs:
        others = sorted(n for p in pairs for n in p - {e.name})
        rows.append("- companions: " + ", ".join(f"`{n}`" for n in others))
    rows += ["", "| parameter | meaning | kind | size | robots |", "|---|---|---|---|---|"]
    rows += _parameters(e)
    return "\n".join(rows) + "\n"


def _sentence(e: Effect) -> str:
    """The title as a sentence, then the first line of the docstring: its formula."""
    formula = " ".join(_paragraphs(e)[0].split())
    return f"{e.title[0].upper()}{e.title[1:]}. {formula}"


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
    words = {"static": "at rest", "dynamic": "in motion"}
    return ", ".join(words[m] for m in e.modes)


def _robots(e: Effect) -> str:
    robots = [n for n, robot in _all_robots().items() if e.applies(robot)]
    return "all" if len(robots) == len(_all_robots()) else ", ".join(robots)


def _all_robots() -> dict[str, Robot]:
    return {n: registry.load("robots", n) for n in registry.names("robots")}


def _in_mujoco(e: Effect) -> str:
    if type(e).edit_spec is not Effect.edit_spec:
        sentence = (inspect.getdoc(type(e).edit_spec) or "").split("\n")[0]
        return f"{sentence[0].lower()}{sentence[1:].rstrip('.')}"
    return STAGES[e.stage].simulated


def _parameters(e: Effect) -> Iterator[str]:
    """One row for parameters that differ in their number or channel alone."""
    robots = {n: r for n, r in _all_robots().items() if e.applies(r)}
    rows: dict[tuple[str, str, str, str], list[str]] = {}
    free = {n for robot in robots.values() for n in _amplitudes(e, robot)}
    for robot_name, robot in robots.items():
        groups: dict[tuple[str, str, str, str], list[str]] = {}
        for p in e.parameters(robot):
            kind = "amplitude" if p.name in free else "shape"
            groups.setdefault((_stem(p.name), _text(p), kind, _size(p)), []).append(p.name)
        for (_, text, kind, size), names in groups.items():
            rows.setdefault((_listed(names), text, kind, size), []).append(robot_name)
    for (listed, text, kind, size), who in rows.items():
        yield f"| {listed} | {text} | {kind} | {size} | {_who(who, robots)} |"


def _amplitudes(e: Effect, robot: Robot) -> set[str]:
    if e.between_rows:
        return {p.name for p in e.parameters(robot) if p.nominal == 0.0}
    return {n for s in examples(robot) for v in e.variants(s) for n in v.free}


def _who(who: list[str], robots: dict[str, Robot]) -> str:
    return "all" if len(who) == len(robots) else ", ".join(who)


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
    if len(names) < 4:
        return ", ".join(f"`{n}`" for n in names)
    return f"`{names[0]}` … `{names[-1]}`"


def _size(p: Parameter) -> str:
    unit = "" if p.unit == "1" else f" {p.unit}"
    degrees = f" ({np.rad2deg(p.tolerance):.2g}°)" if p.unit == "rad" else ""
    return f"{p.tolerance:.3g}{unit}{degrees}"
