"""The targets of scripts/fuzz on their seeds, on pieces of them, and on random bytes."""

import random
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

SCRIPT = Path(__file__).parents[2] / "scripts" / "fuzz"


def load():
    loader = SourceFileLoader("fuzz_script", str(SCRIPT))
    module = module_from_spec(spec_from_loader("fuzz_script", loader))
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = before
    return module


FUZZ = load()


@pytest.fixture(scope="module", params=FUZZ.TARGETS)
def target(request):
    return FUZZ.TARGETS[request.param]()


def test_seeds_pass_and_so_does_what_is_left_of_them(target):
    run, seeds = target
    dice = random.Random(7)
    assert seeds
    for seed in seeds:
        run(seed)
        for _ in range(300):
            data = bytearray(seed)
            for _ in range(dice.randrange(1, 4)):
                at = dice.randrange(len(data))
                data[at] = dice.randrange(256)
            run(bytes(data[: dice.randrange(1, len(data) + 1)]))


@pytest.mark.parametrize("name", FUZZ.TARGETS)
def test_random_bytes_pass(name):
    run, _ = FUZZ.TARGETS[name]()

    @settings(deadline=None, max_examples=150)
    @given(st.binary(max_size=300))
    def feed(data):
        run(data)

    feed()


def test_without_atheris_the_remedy_is_named(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(
        "import importlib.util as u\nfind = u.find_spec\n"
        "u.find_spec = lambda n, *a: None if n == 'atheris' else find(n, *a)\n"
    )
    done = subprocess.run(
        [sys.executable, SCRIPT, "rdt"], capture_output=True, text=True, timeout=30,
        env={"PYTHONPATH": str(tmp_path), "PATH": ""},
    )  # fmt: skip
    assert done.returncode == 2
    assert "pip install atheris" in done.stderr


def test_pieces_of_a_stream():
    assert FUZZ.chunks(FUZZ.joined(b"ab", b"c")) == [b"ab", b"c"]
    assert FUZZ.chunks(b"\xffx") == [b"x"]
