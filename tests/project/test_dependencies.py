"""Locked packages have hashes and allowed licences, and hold all that is declared."""

import hashlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TESTED = ("dev", "hil", "logs", "docs", "report", "view")
"""Extras of which tests need the packages."""


def test_every_locked_package_has_a_listed_and_allowed_licence():
    command = [sys.executable, str(ROOT / "scripts" / "licences"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("lock", ["run", "test"])
def test_every_locked_package_has_hashes(lock):
    text = (ROOT / "requirements" / f"{lock}.txt").read_text(encoding="utf-8")
    blocks = re.split(r"^(?=\S)", text, flags=re.MULTILINE)
    packages = [b for b in blocks if b.strip() and not b.startswith("#")]
    assert len(packages) > 20
    for block in packages:
        assert re.match(r"[A-Za-z0-9._-]+==\S+", block), block[:60]
        assert "--hash=sha256:" in block, block[:60]


def test_the_locks_hold_what_the_project_declares():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extra, core = project["optional-dependencies"], project["dependencies"]
    for lock, extras in {"run": ("report", "view"), "test": TESTED}.items():
        text = (ROOT / "requirements" / f"{lock}.txt").read_text(encoding="utf-8")
        locked = set(re.findall(r"^([a-z0-9._-]+)==", text, re.MULTILINE))
        declared = [*core, *(x for e in extras for x in extra[e])]
        names = {re.match(r"[A-Za-z0-9._-]+", d)[0].lower().replace("_", "-") for d in declared}
        assert names <= locked, names - locked


def test_the_script_that_pages_carry_is_the_listed_one_with_its_licences():
    assets = ROOT / "src" / "wrenchbed" / "pages" / "assets"
    listed = (assets / "LICENCES.md").read_text(encoding="utf-8")
    digest = hashlib.sha256((assets / "echarts.min.js").read_bytes()).hexdigest()
    assert digest in listed
    for name in re.findall(r"`((?:echarts|zrender|tslib)\.(?:LICENSE|NOTICE)[^`]*)`", listed):
        assert len((assets / name).read_text(encoding="utf-8")) > 100, name
    carried = {p.name for p in assets.iterdir()}
    assert carried - {"page.js"} == {n for n in carried if n in listed or n == "LICENCES.md"}
