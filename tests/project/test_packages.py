"""Wheel and source distribution: what travels inside and works there; locks and licences."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIBRARY = "wrenchbed/robots/compiled/_statics.abi3.so"
INSIDE = {
    LIBRARY,
    *(f"wrenchbed/models/{robot}/{robot}.xml" for robot in ("ur5", "medrue")),
    "wrenchbed/py.typed",
    "wrenchbed/pages/study.html.j2",
    *(
        f"wrenchbed/pages/assets/{asset}"
        for asset in ("echarts.min.js", "echarts.LICENSE", "zrender.LICENSE", "page.js")
    ),
}


def run(*command: str, cwd: Path, **env: str) -> str:
    done = subprocess.run(
        command, cwd=cwd, env=os.environ | env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr + done.stdout[-2000:]
    return done.stdout


def built(folder: Path, **env: str) -> Path:
    pip = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    run(*pip, "--wheel-dir", str(folder), str(ROOT), cwd=folder, **env)
    (wheel,) = folder.glob("wrenchbed-*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    return built(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory):
    """The unpacked wheel, read-only, in a folder with spaces and umlauts that anybody may enter."""
    site = tmp_path_factory.mktemp("site") / "Prüfstand für Köln" / "site packages"
    install = ("install", "--quiet", "--no-deps", "--no-compile", "--target", str(site))
    run(sys.executable, "-m", "pip", *install, str(wheel), cwd=wheel.parent)
    for parent in (site.parent, *list(site.parents)[1:4]):
        parent.chmod(0o755)
    for path in (*site.rglob("*"), site):
        path.chmod(0o555 if path.is_dir() else 0o444)
    yield site
    for path in (site, *(p for p in site.rglob("*") if p.is_dir())):
        path.chmod(0o755)


@pytest.mark.slow
def test_it_carries_models_pages_and_what_is_compiled(wheel):
    missing = INSIDE - set(zipfile.ZipFile(wheel).namelist())
    compiled = shutil.which("cc") is not None
    assert missing == (set() if compiled else {LIBRARY})
    assert ("-cp311-abi3-" in wheel.name) == compiled


def test_without_a_compiler_the_wheel_is_plain(tmp_path):
    wheel = built(tmp_path, CC="no-such-compiler")
    assert wheel.name.endswith("-py3-none-any.whl")
    assert LIBRARY not in zipfile.ZipFile(wheel).namelist()


def obeying() -> list[str]:
    """What makes root obey the rights of files, as any other user does."""
    setpriv = shutil.which("setpriv")
    if os.geteuid() != 0 or setpriv is None:
        return []
    without = "-dac_override,-dac_read_search,-fowner"
    return [setpriv, "--bounding-set", without, "--inh-caps", without, "--"]


@pytest.mark.slow
def test_it_works_read_only_without_home_in_the_c_locale(site):
    work = site.parents[1] / "Aufnahme übers Meer"
    work.mkdir(mode=0o777)
    plain = {"PATH": "/usr/bin:/bin", "LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    plain |= {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(site), "TMPDIR": str(work)}

    def verb(line: str, *more: str) -> str:
        command = [*obeying(), sys.executable, "-m", "wrenchbed", *line.split(), *more]
        done = subprocess.run(
            command, cwd=work, env=plain, capture_output=True, check=False, timeout=120.0
        )
        assert done.returncode == 0, (command, done.stderr[-1500:])
        return done.stdout.decode("ascii")

    before = sorted(site.rglob("*"))
    assert verb("--version").startswith("wrenchbed ")
    verb("plan ur5 --n 20 --out pläne.parquet")
    verb("record --robot ur5 --plan pläne.parquet --samples 5 --out", "r ü.parquet")
    assert "converged" in verb("calibrate", "r ü.parquet", "--out", "fit ö.json")
    verb("diagnose", "r ü.parquet", "--out", "fünd")
    assert (work / "fünd" / "report.html").is_file() and (work / "fit ö.json").is_file()
    assert sorted(site.rglob("*")) == before


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sdist")
    hatchling = ("hatchling", "build", "--target", "sdist", "--directory", str(folder))
    run(sys.executable, "-m", *hatchling, cwd=ROOT)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    (root,) = (p for p in folder.iterdir() if p.is_dir())
    return root


@pytest.mark.slow
def test_the_source_carries_what_set_up_and_tests_need(unpacked):
    assert os.access(unpacked / "scripts" / "test", os.X_OK)
    folders = ("tests", "docs", "models", "requirements", "src", "scripts", ".ci", "mkdocs.yml")
    listed = subprocess.run(
        ["git", "ls-files", *folders], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode == 0:  # in a clone: all that is tracked is there
        absent = [n for n in listed.stdout.splitlines() if not (unpacked / n).exists()]
        assert not [n for n in absent if (ROOT / n).exists()]


TESTED = ("dev", "hil", "logs", "docs", "report", "view")
"""Extras of which tests need the packages."""


def test_every_locked_package_has_a_listed_and_allowed_licence():
    command = [sys.executable, str(ROOT / "scripts" / "licences"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_locks_hold_what_the_project_declares():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extra, core = project["optional-dependencies"], project["dependencies"]
    for lock, extras in {"run": ("report", "view"), "test": TESTED}.items():
        text = (ROOT / "requirements" / f"{lock}.txt").read_text(encoding="utf-8")
        locked = set(re.findall(r"^([a-z0-9._-]+)==", text, re.MULTILINE))
        declared = [*core, *(x for e in extras for x in extra[e])]
        names = {re.match(r"[A-Za-z0-9._-]+", d)[0].lower().replace("_", "-") for d in declared}
        assert names <= locked, names - locked


def test_the_scripts_that_pages_carry_are_the_listed_ones_with_their_licences():
    assets = ROOT / "src" / "wrenchbed" / "pages" / "assets"
    listed = (assets / "LICENCES.md").read_text(encoding="utf-8")
    for library in ("echarts.min.js", "three.min.js"):
        row = next(line for line in listed.splitlines() if line.startswith(f"| `{library}`"))
        assert hashlib.sha256((assets / library).read_bytes()).hexdigest() in row
    for name in re.findall(r"`((?:echarts|zrender|tslib|three)\.(?:LICENSE|NOTICE)[^`]*)`", listed):
        assert len((assets / name).read_text(encoding="utf-8")) > 100, name
    carried = {p.name for p in assets.iterdir()}
    assert carried - {"page.js", "scene.js"} == {
        n for n in carried if n in listed or n == "LICENCES.md"
    }
