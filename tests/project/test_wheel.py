"""An installed wheel works from any folder: its models travel inside."""

import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run(*command: str, cwd: Path) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


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
    site = tmp_path / "site"
    run(*pip, "install", "--quiet", "--no-deps", "--target", str(site), str(wheel), cwd=tmp_path)
    code = (
        f"import sys; sys.path.insert(0, {str(site)!r})\n"
        "import numpy, wrenchbed\n"
        "from wrenchbed.robots.base import models\n"
        f"assert wrenchbed.__file__.startswith({str(site)!r}), wrenchbed.__file__\n"
        f"assert str(models()).startswith({str(site)!r}), models()\n"
        "for name in ('ur5', 'medrue'):\n"
        "    robot = wrenchbed.load('robots', name)\n"
        "    q = robot.sample(2, numpy.random.default_rng(0))\n"
        "    print(wrenchbed.Simulation(robot, robot.parameters.nominal).wrench(q).shape)\n"
    )
    assert run(sys.executable, "-I", "-c", code, cwd=tmp_path).count("(2, 6)") == 2
