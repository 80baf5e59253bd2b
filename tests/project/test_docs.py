"""README's lines run, and what the docs name exists."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import wrenchbed
from wrenchbed import registry
from wrenchbed.simulation.closed_form import SENSOR

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_python_lines_run(tmp_path):
    (code,) = blocks("python")
    lines = [line for line in code.splitlines() if line]
    assert len(lines) <= 15
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "converged" in done.stdout
    assert "d41 and d42 enter only as their sum" in done.stdout


def test_the_shell_lines_run(tmp_path):
    shell = blocks("sh")[1]
    data = ROOT / "tests" / "data" / "ntnu_kuka_ati_gamma"
    example = Path("models", "ur5", "example.json")
    (tmp_path / example).parent.mkdir(parents=True)
    (tmp_path / example).write_bytes((ROOT / example).read_bytes())
    raw = (data / "static.toml").read_text().replace("0-calibration_fts-accel.csv", "data.csv")
    (tmp_path / "map.toml").write_text(raw)
    (tmp_path / "data.csv").write_bytes((data / "0-calibration_fts-accel.csv").read_bytes())
    for line in shell.strip().splitlines():
        arguments = line.split()
        assert arguments[0] == "wrenchbed"
        command = [sys.executable, "-m", "wrenchbed", *arguments[1:]]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "fit.json").exists()


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.md")), ids=lambda p: p.name)
def test_links_lead_somewhere(path):
    if ".venv" in path.parts:
        return
    for target in re.findall(r"\]\(([^)#]+)\)", path.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (path.parent / target).exists(), f"{path.name}: {target}"


def test_public_names_exist():
    for name in wrenchbed.__all__:
        assert getattr(wrenchbed, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = wrenchbed.nothing


def test_every_parameter_is_in_the_nomenclature():
    text = (ROOT / "docs" / "reference" / "nomenclature.md").read_text(encoding="utf-8")
    stems = set(re.findall(r"`([A-Za-z0-9.]+)", text)) | set(re.findall(r"[A-Za-z0-9.]+", text))
    known = [p.name for p in SENSOR]
    for name in registry.names("robots"):
        known += registry.load("robots", name).parameters.names
    for name in set(known):
        group = name.rsplit(".", 1)[0]
        numbered = name.rstrip("123456789")
        close = {name, group, f"{group}.x", f"{group}.xx", f"{group}.fx", f"{numbered}1"}
        series = {f"L{i}1" for i in (1, 2)} if name.startswith("L") else set()
        assert (close | series) & stems, name
