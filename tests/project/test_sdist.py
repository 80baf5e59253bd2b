"""The source distribution carries what its tests and set-up need, and passes tests of its own."""

import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NEEDED = (
    "requirements/run.txt", "requirements/test.txt", "requirements/licences.txt", "scripts/test",
    "scripts/environment.sh", "scripts/demo", ".ci/run", "mkdocs.yml", "CONTRIBUTING.md",
    "docs/contracts.md", "docs/tutorials/notebook.ipynb", "models/ur5/example.json",
    "models/ur5/ur5.xml", "models/medrue/medrue.xml", "tests/conftest.py",
    "tests/support/simulated.py",
    "tests/data/ntnu_kuka_ati_gamma/0-calibration_fts-accel.csv", "src/wrenchbed/py.typed",
)  # fmt: skip
SAMPLE = ("tests/project/test_dependencies.py", "tests/project/test_scripts.py",
          "tests/cli/test_set_options.py", "tests/robots/test_parameters.py",
          "tests/data/test_conventions.py")  # fmt: skip


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    """The source distribution, built and unpacked elsewhere."""
    folder = tmp_path_factory.mktemp("sdist")
    hatchling = ("hatchling", "build", "--target", "sdist", "--directory", str(folder))
    command = [sys.executable, "-m", *hatchling]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    (root,) = (p for p in folder.iterdir() if p.is_dir())
    return root


@pytest.mark.slow
def test_it_carries_what_set_up_and_tests_need(unpacked):
    missing = [name for name in NEEDED if not (unpacked / name).is_file()]
    assert not missing
    assert os.access(unpacked / "scripts" / "test", os.X_OK)
    folders = ("tests", "docs", "models", "requirements", "src")
    listed = subprocess.run(
        ["git", "ls-files", *folders], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode == 0:  # in a clone: all that is tracked is there
        absent = [n for n in listed.stdout.splitlines() if not (unpacked / n).exists()]
        assert not [n for n in absent if (ROOT / n).exists()]


@pytest.mark.slow
def test_a_sample_of_its_own_tests_passes_there(unpacked):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *SAMPLE], cwd=unpacked,
        env=os.environ | {"PYTHONPATH": str(unpacked / "src")}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:]
