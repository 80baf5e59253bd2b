"""Whatever reads a wire, on valid messages, on pieces of them, and on random bytes."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ur5_fuzz import chunks, joined
from wire_fuzz import TARGETS


@pytest.fixture(scope="module", params=TARGETS)
def target(request):
    return TARGETS[request.param]()


@pytest.mark.sampled
def test_changed_pieces_of_valid_messages_raise_named_errors_only(target):
    run, seeds = target
    dice = random.Random(7)
    assert seeds
    for seed in seeds:
        run(seed)
        for _ in range(300):
            data = bytearray(seed)
            for _ in range(dice.randrange(1, 4)):
                data[dice.randrange(len(data))] = dice.randrange(256)
            run(bytes(data[: dice.randrange(1, len(data) + 1)]))


@pytest.mark.parametrize("name", TARGETS)
def test_random_bytes_raise_named_errors_only(name):
    run, _ = TARGETS[name]()

    @settings(deadline=None, max_examples=150)
    @given(st.binary(max_size=300))
    def feed(data):
        run(data)

    feed()


def test_a_stream_is_cut_into_pieces_and_joined_again():
    assert chunks(joined(b"ab", b"c")) == [b"ab", b"c"]
    assert chunks(b"\xffx") == [b"x"]
