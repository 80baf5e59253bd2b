"""One BLAS thread a test process: with several processes more threads only wait for each other."""

import os
import shutil
import sys
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo reads it once


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Tests of a file, and all of the sealed family, share a process: what they use is made once.

    Groups by mark (--dist loadgroup) do nothing in pytest 9.2 with xdist 3.8.
    """
    from xdist.scheduler import LoadFileScheduling

    class ByFile(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return "sealed" if "test_sealed" in file else file

    return ByFile(config, log)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Of a parametrised test that is `sampled`, every case but the first is slow."""
    seen = set()
    for item in items:
        if item.get_closest_marker("sampled"):
            test = (item.path, item.originalname)
            if test in seen:
                item.add_marker("slow")
            seen.add(test)


@pytest.fixture(scope="session")
def family(tmp_path_factory):
    """Cases and answers of a small sealed family, and the SHA-256 of its commitments."""
    from sealed_family import made

    return made(tmp_path_factory.mktemp("sealed"))


@pytest.fixture
def copied(family, tmp_path):
    """A family that may be spoiled."""
    cases, answers, _ = family
    return (
        Path(shutil.copytree(cases, tmp_path / "cases")),
        Path(shutil.copytree(answers, tmp_path / "answers")),
    )


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Path:
    """A plan, a recording and a fit of the UR5, which tests only read."""
    from wrenchbed.cli import main

    folder = tmp_path_factory.mktemp("made")
    plan, rec, fit = (str(folder / n) for n in ("plan.parquet", "rec.parquet", "fit.json"))
    assert main(["plan", "ur5", "--n", "20", "--out", plan]) == 0
    run = ["record", "--robot", "ur5", "--plan", plan, "--out", rec, "--samples", "5"]
    assert main(run) == 0
    assert main(["calibrate", rec, "--out", fit]) == 0
    return folder


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    """The working folder, with a plan and a recording."""
    monkeypatch.chdir(tmp_path)
    for name, short in (("plan", "p"), ("rec", "r")):
        shutil.copy(made / f"{name}.parquet", f"{short}.parquet")
    return tmp_path


@pytest.fixture
def fresh_registry(request):
    """Forget, after the test, what it registered."""
    from wrenchbed import registry  # slow: only where it is used

    request.addfinalizer(registry.forget())
