"""What a fit publishes of plausible recordings holds the truth, however they were broken."""

import numpy as np
import pytest

from sound import BASES, SOUND, good
from subtle import SUBTLE
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.errors import WrenchbedError

EVERY = 9
"""One of so many faults is tried on each kind of recording; `scripts/corruptions` tries all."""


def far(fit, truth):
    """Largest error in standard uncertainties."""
    return max(abs(p.value - truth.get(p.name, p.nominal)) / p.std for p in fit.identified if p.std)


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_a_broken_recording_publishes_nothing_false(base):
    names = [name for name, way in SUBTLE.items() if base in way.bases]
    published = refused = 0
    for place, name in enumerate(names[BASES.index(base) :: EVERY]):
        broken = SUBTLE[name].make(good(base, 31), base, np.random.default_rng([31, place]))
        try:
            fit = calibrate(broken.recording)
        except WrenchbedError:
            refused += 1
            continue
        published += 1
        assert far(fit, broken.truth) < 5.0, name
    assert min(published, refused) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_a_sound_recording_is_published_however_it_was_recorded(base):
    sound = good(base, 32)
    for place, (name, vary) in enumerate(SOUND.items()):
        fit = calibrate(vary(sound.recording, np.random.default_rng([32, place])))
        assert far(fit, sound.truth) < 5.0, name


@pytest.mark.parametrize(
    ("name", "base", "words"),
    [
        ("wrench -1 rows late", "oriented", "the wrench is early"),
        ("low-passed, 0.2", "oriented", "a wrench that is late or filtered"),
        ("wrench 1 rows late", "oriented", "Leave out the first 1 rows of each pose"),
        ("wrench 2 rows late", "oriented", "Leave out the first 2 rows of each pose"),
        ("low-passed, 0.6", "oriented", "those of the move before"),
        ("5 % lost", "oriented", "all channels are exactly 0"),
        ("10 rows lost twice", "oriented", "all channels are exactly 0"),
        ("5 % of fz lost", "oriented", "column 'fz' is exactly 0 in"),
        ("time × 0.95, rate too", "motion", "a clock of another rate"),
        ("drift of 30 rows' noise", "motion", "a zero that drifts"),
        ("q3 off by 3°", "ur5", "a wrong zero of q3"),
    ],
)
def test_a_refusal_names_the_fault(name, base, words):
    broken = SUBTLE[name].make(good(base, 33), base, np.random.default_rng(33))
    with pytest.raises(WrenchbedError) as caught:
        calibrate(broken.recording)
    assert words in str(caught.value)


@pytest.mark.parametrize("name", ["gain of fx +5 %", "gain of fx +10 %"])
def test_an_interval_holds_what_each_of_the_faults_that_explain_alike_would_move(name):
    """A gain of fx in a narrow motion looks like faults that move other values."""
    rng = np.random.default_rng([902, sum(map(ord, name)), 77])  # as scripts/corruptions draws it
    broken = SUBTLE[name].make(good("motion", 902), "motion", rng)
    assert far(calibrate(broken.recording), broken.truth) < 3.0
