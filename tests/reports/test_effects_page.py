"""docs/reference/effects.md says what the registry holds."""

import importlib.util
from importlib.machinery import SourceFileLoader
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "scripts" / "effects"
LOADER = SourceFileLoader("effects_page", str(SCRIPT))
page = importlib.util.module_from_spec(importlib.util.spec_from_loader("effects_page", LOADER))
LOADER.exec_module(page)
TEXT = page.render()


def test_the_committed_page_is_the_rendered_one():
    assert page.PAGE.read_text(encoding="utf-8") == TEXT, "run scripts/effects"
