"""A short round of `scripts/fuzz --count`: mutated files of every format, and what once failed."""

import random
from contextlib import closing

import pytest

from file_fuzz import CORPUS, LOGS, SETTINGS, Runner, corpus, mutated

TARGETS = LOGS | SETTINGS
ROUNDS = 40


@pytest.mark.sampled
@pytest.mark.parametrize("name", TARGETS)
def test_mutated_files_are_read_right_or_refused_by_name(name):
    target = TARGETS[name]()
    dice = random.Random(f"short {name}")
    with closing(Runner(target)) as runner:
        for _ in range(ROUNDS):
            runner.run(*mutated(target, dice))
        assert runner.accepted + runner.refused == ROUNDS
        assert runner.refused or name == "sealed"  # whose readers answer instead of raising
        for data in corpus(name):
            runner(data)


def test_the_corpus_is_small_and_every_target_of_it_exists():
    files = [path for path in CORPUS.rglob("*") if path.is_file()]
    assert {path.parent.name for path in files} <= set(TARGETS)
    assert files and sum(path.stat().st_size for path in files) < 50_000
