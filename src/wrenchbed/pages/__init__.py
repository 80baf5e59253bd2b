"""HTML pages, plots and numbers for people: self-contained, light and dark, for screens and A4.
May import: the root files only.
Read first: this file; then `document` (studies), `plots` and `numbers`.
"""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.errors import printable
from wrenchbed.files import write_text


def rendered(template: str, context: Mapping[str, Any]) -> str:
    """One self-contained page.

    Args:
        template: ``diagnosis``, ``recording`` or ``study``.
        context: what it shows, by name; ``verdict``, if any, chooses its colour.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    jinja2 = registry.require("jinja2", "report")
    environment = jinja2.Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_cleaned,
        loader=jinja2.FunctionLoader(_text),
    )
    return str(environment.get_template(f"{template}.html.j2").render(context))


def write_page(path: str | Path, template: str, context: Mapping[str, Any]) -> None:
    """Write a page as `rendered` makes it, atomically."""
    write_text(path, rendered(template, context))


def _cleaned(value: Any) -> Any:
    """What a template prints: in texts, unless they are HTML, control characters spelled out."""
    return printable(value) if type(value) is str else value


def _text(name: str) -> str:
    return (files("wrenchbed.pages") / name).read_text(encoding="utf-8")
