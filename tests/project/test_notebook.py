"""The notebook of the documentation runs, and prints what it holds."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "docs" / "tutorials" / "notebook.ipynb"
NUMBER = r"-?\d+\.?\d*(?:e-?\d+)?"


@pytest.mark.slow
def test_the_notebook_prints_what_it_holds(tmp_path):
    pytest.importorskip("matplotlib")
    cells = [
        c for c in json.loads(NOTEBOOK.read_text("utf-8"))["cells"] if c["cell_type"] == "code"
    ]
    held = "".join(
        "".join(output["text"]) for c in cells for output in c["outputs"] if "text" in output
    )
    assert "identified\njoint.compliance" in held
    code = "\n".join("".join(c["source"]) for c in cells)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg"}, check=True,
    )  # fmt: skip
    assert re.sub(NUMBER, "#", done.stdout) == re.sub(NUMBER, "#", held)
    printed = [float(x) for x in re.findall(NUMBER, done.stdout)]
    assert printed == pytest.approx([float(x) for x in re.findall(NUMBER, held)], rel=1e-2)
