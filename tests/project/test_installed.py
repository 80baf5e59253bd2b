"""The wheel, installed where nothing can be written, in the plainest environment, does its work."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site() -> Iterator[Path]:
    """The unpacked wheel, read-only, in a folder with spaces and umlauts that anybody may enter."""
    with tempfile.TemporaryDirectory(prefix="wrenchbed-") as name:
        folder = Path(name)
        folder.chmod(0o755)
        pip = (sys.executable, "-m", "pip")
        build = ("wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", name)
        subprocess.run([*pip, *build, str(ROOT)], cwd=folder, check=True)
        (wheel,) = folder.glob("wrenchbed-*.whl")
        site = folder / "Prüfstand für Köln" / "site packages"
        install = ("install", "--quiet", "--no-deps", "--no-compile", "--target", str(site))
        subprocess.run([*pip, *install, str(wheel)], cwd=folder, check=True)
        site.parent.chmod(0o755)
        for path in (*site.rglob("*"), site):
            path.chmod(0o555 if path.is_dir() else 0o444)
        yield site
        for path in (site, *(p for p in site.rglob("*") if p.is_dir())):
            path.chmod(0o755)


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
    work.mkdir()
    work.chmod(0o777)
    plain = {"PATH": "/usr/bin:/bin", "LC_ALL": "C", "PYTHONIOENCODING": "ascii",
             "OMP_NUM_THREADS": "1", "PYTHONPATH": str(site), "TMPDIR": str(work)}  # fmt: skip

    def verb(*words: str) -> str:
        done = subprocess.run(
            [*obeying(), sys.executable, "-m", "wrenchbed", *words], cwd=work, env=plain,
            capture_output=True, check=False, timeout=120.0,
        )  # fmt: skip
        assert done.returncode == 0, (words, done.stderr[-1500:])
        return done.stdout.decode("ascii")

    before = sorted(site.rglob("*"))
    assert verb("--version").startswith("wrenchbed ")
    verb("plan", "ur5", "--n", "20", "--out", "pläne.parquet")
    recorded = ("--samples", "5", "--out", "r ü.parquet")
    verb("record", "--robot", "ur5", "--plan", "pläne.parquet", *recorded)
    assert "->" in verb("calibrate", "r ü.parquet", "--out", "fit ö.json")
    verb("diagnose", "r ü.parquet", "--fast", "--out", "fünd")
    assert (work / "fünd" / "report.html").is_file() and (work / "fit ö.json").is_file()
    assert sorted(site.rglob("*")) == before
