"""An installed wheel works from any folder: its models travel inside, and what is compiled."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


LIBRARY = "wrenchbed/robots/compiled/_statics.abi3.so"


def run(*command: str, cwd: Path, **env: str) -> str:
    done = subprocess.run(
        command, cwd=cwd, env=os.environ | env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_wheel_finds_its_models_from_another_folder(tmp_path):
    pip = (sys.executable, "-m", "pip")
    build = ("wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(tmp_path))
    run(*pip, *build, str(ROOT), cwd=tmp_path)
    (wheel,) = tmp_path.glob("wrenchbed-*.whl")
    inside = zipfile.ZipFile(wheel).namelist()
    for robot in ("ur5", "medrue"):
        assert f"wrenchbed/models/{robot}/{robot}.xml" in inside
    assert "wrenchbed/py.typed" in inside
    assert "wrenchbed/pages/study.html.j2" in inside
    for asset in ("echarts.min.js", "echarts.LICENSE", "zrender.LICENSE", "page.js"):
        assert f"wrenchbed/pages/assets/{asset}" in inside
    compiled = shutil.which("cc") is not None
    assert (LIBRARY in inside) == compiled == ("-cp311-abi3-" in wheel.name)
    site = tmp_path / "site"
    run(*pip, "install", "--quiet", "--no-deps", "--target", str(site), str(wheel), cwd=tmp_path)
    code = (
        f"import sys; sys.path.insert(0, {str(site)!r})\n"
        "import numpy, wrenchbed\n"
        "from wrenchbed.robots.base import models\n"
        "from wrenchbed.robots.compiled.statics import available\n"
        f"assert available('chain') == available('medrue') == {compiled}\n"
        f"assert wrenchbed.__file__.startswith({str(site)!r}), wrenchbed.__file__\n"
        f"assert str(models()).startswith({str(site)!r}), models()\n"
        "for name in ('ur5', 'medrue'):\n"
        "    robot = wrenchbed.load('robots', name)\n"
        "    q = robot.sample(2, numpy.random.default_rng(0))\n"
        "    print(wrenchbed.Simulation(robot, robot.parameters.nominal).wrench(q).shape)\n"
    )
    assert run(sys.executable, "-I", "-c", code, cwd=tmp_path).count("(2, 6)") == 2


def test_without_a_compiler_the_wheel_is_plain(tmp_path):
    pip = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    run(*pip, "--wheel-dir", str(tmp_path), str(ROOT), cwd=tmp_path, CC="no-such-compiler")
    (wheel,) = tmp_path.glob("wrenchbed-*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    assert LIBRARY not in zipfile.ZipFile(wheel).namelist()
