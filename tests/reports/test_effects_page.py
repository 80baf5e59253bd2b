"""docs/reference/effects.md says what the registry holds."""

import importlib.util
from importlib.machinery import SourceFileLoader
from pathlib import Path

import pytest

from wrenchbed import registry
from wrenchbed.diagnosis.explain.verdict import INSEPARABLE
from wrenchbed.effects.base import SHOWN, STAGES

SCRIPT = Path(__file__).parents[2] / "scripts" / "effects"
LOADER = SourceFileLoader("effects_page", str(SCRIPT))
page = importlib.util.module_from_spec(importlib.util.spec_from_loader("effects_page", LOADER))
LOADER.exec_module(page)
TEXT = page.render()


def section(name: str) -> str:
    return TEXT.split(f"\n### {name}\n")[1].split("\n### ")[0]


def test_the_committed_page_is_the_rendered_one():
    assert page.PAGE.read_text(encoding="utf-8") == TEXT, "run scripts/effects"


def test_the_introduction_states_every_stage_and_every_variable_of_a_figure():
    introduction = TEXT.partition("## All effects")[0]
    assert all(f"| {name} | {stage.changes} |" in introduction for name, stage in STAGES.items())
    for name, text in SHOWN.items():
        assert name == "prediction" or f"`{name}`: {text}" in introduction


@pytest.mark.parametrize("name", registry.names("effects"))
def test_every_effect_says_all_about_itself(name):
    effect, text = registry.load("effects", name), section(name)
    assert effect.title[1:] in text and effect.source in text
    assert f"stage: {effect.stage}" in text and page.seen_in(effect) in text
    assert "- in MuJoCo: " in text and "- seen in: " in text
    for robot in ("ur5", "medrue"):
        for p in effect.parameters(registry.load("robots", robot)):
            stem = p.name.partition(".")[0]
            assert f"`{p.name}`" in text or f"`{stem}." in text, p.name


def test_companions_that_no_data_separates_are_named():
    for pair in INSEPARABLE:
        a, b = sorted(pair)
        assert f"companions: `{b}`" in section(a) or f"`{b}`" in section(a).split("| parameter")[0]
        assert f"`{a}`" in section(b).split("| parameter")[0]
