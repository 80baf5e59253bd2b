"""One BLAS thread a test process: with several processes more threads only wait for each other."""

import os
import shutil
from pathlib import Path

import pytest

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")


def pytest_collection_modifyitems(items):
    """Tests of the sealed family run in one process, so that it is made once."""
    for item in items:
        if "family" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("sealed"))


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


@pytest.fixture(scope="module")
def bench(request):
    """A UR5's twin at the module's HOST, an observer, and the driver with its options DRIVER."""
    import rtde_moves

    more = getattr(request.module, "DRIVER", {})
    with rtde_moves.bench(request.module.HOST, **more) as made:
        yield made


@pytest.fixture
def link(bench):
    """The driver, active and in order."""
    return bench.ready()
