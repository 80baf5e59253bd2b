"""HTML pages, plots and numbers for people: self-contained, light and dark, for screens and A4.
Free: the inside of each file (styles and layout); tests/reports speak.
Others rely on: digits and units of `numbers`, printed by cli too: run tests/cli; fields of `chart`
and `scene`: change ``assets/page.js`` and ``assets/scene.js``, which read them, together with them.
Never: a robot, a recording or a fit: this room draws data that it is given; a script or address
that the page's security policy does not allow.
Read first: this file; then `chart` (the data of a figure), `draw` and ``assets/page.js`` (its two
renderers), `scene`, ``assets/scene.js`` (robots), `document`, `study_charts`, `numbers`."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from wrenchbed import registry
from wrenchbed.errors import printable
from wrenchbed.files import write_text
from wrenchbed.pages.draw import Drawn
from wrenchbed.pages.scene import Scene

LIBRARY, SCRIPT = "assets/echarts.min.js", "assets/page.js"
"""Apache ECharts 6.1.0 as npm has it (licences beside it), and the page's script that uses it."""
SOLIDS = ("assets/three.min.js", "assets/scene.js")
"""The parts of three.js 0.187.0 that are used, and the script of a page with a robot."""


@dataclass(frozen=True)
class ReportPage:
    """An HTML page with its data, ready to be written.

    Attributes:
        context: values that the template shows, by name; ``verdict``, if any, chooses its colour.
        template: name of the jinja2 template, of a kind of page, with ``.html`` or ``.md``.
        figures: interactive figures; libraries that none of them needs are left out.
    """

    context: Mapping[str, Any]
    template: str
    figures: Sequence[Drawn] = ()

    def html(self) -> str:
        """Return the self-contained page; a browser runs its own scripts and no other. A
        `MissingExtraError` without jinja2."""
        jinja2 = registry.require("jinja2", "report")
        environment = jinja2.Environment(
            autoescape=self.template.endswith("html"), trim_blocks=True, lstrip_blocks=True,
            finalize=_cleaned, loader=jinja2.FunctionLoader(_text),
        )  # fmt: skip
        environment.filters["code"] = _code
        solid = any(isinstance(f.chart, Scene) for f in self.figures)
        libraries = (*([LIBRARY] if self.figures else []), *(SOLIDS if solid else ()))
        scripts = [_script(name) for name in (*libraries, SCRIPT)]
        data = {f.chart.name: f.chart.to_json() for f in self.figures}
        charts = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
        assets = {
            "scripts": [text for text, _ in scripts],
            "allowed": " ".join(digest for _, digest in scripts),
            "charts": charts.replace("<", "\\u003c"),  # no end of the script within it
        }
        template = environment.get_template(f"{self.template}.j2")
        return str(template.render({**self.context, **assets}))

    def write(self, path: str | Path) -> None:
        """Write the page to an HTML file, atomically."""
        write_text(path, self.html())


@cache
def _script(name: str) -> tuple[str, str]:
    """Text of a script file, and its entry (hash) in the page's content security policy."""
    text = "\n" + _text(name).rstrip() + "\n"
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return text, f"'sha256-{digest}'"


def _code(text: str) -> Any:
    """HTML of a text in which words between backticks are marked as code."""
    html = registry.require("markupsafe", "report")
    parts = [html.escape(printable(part)) for part in str(text).split("`")]
    if len(parts) % 2 == 0:  # one that is alone is a character like others
        return html.escape(printable(str(text)))
    begin, end = html.Markup("<code>"), html.Markup("</code>")
    whole = parts[0]
    for code, plain in zip(parts[1::2], parts[2::2], strict=True):
        whole = whole + begin + code + end + plain
    return whole


def _cleaned(value: Any) -> Any:
    """Escape control characters in a template's value, if it is a text; HTML is left as it is."""
    return printable(value) if type(value) is str else value


def _text(name: str) -> str:
    return (files("wrenchbed.pages") / name).read_text(encoding="utf-8")
