"""The data of `scripts/study_drives`, and our side of it; the other programs are not needed."""

import importlib.machinery
import importlib.util
import os
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture(scope="module")
def study():
    path, before = str(SCRIPTS / "study_drives"), dict(os.environ)
    loader = importlib.machinery.SourceFileLoader("study_drives", path)
    spec = importlib.util.spec_from_loader("study_drives", loader)
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(SCRIPTS))
    sys.modules["study_drives"] = module  # dataclasses look there
    try:
        loader.exec_module(module)
        yield module
    finally:
        sys.path.remove(str(SCRIPTS))
        for name in ("study_drives", "drive_cases", "benching"):
            sys.modules.pop(name, None)
        os.environ.clear()
        os.environ.update(before)  # the script sets the number of threads


@pytest.fixture(scope="module")
def one(study):
    return study.case(5, 30.0)


def test_a_case_follows_from_its_seed(study, one):
    again, other = study.case(5, 30.0), study.case(6, 30.0)
    assert np.array_equal(again.seen[0].torque, one.seen[0].torque)
    assert again.friction == one.friction and again.payload == one.payload
    assert not np.array_equal(other.seen[0].torque, one.seen[0].torque)
    assert not np.array_equal(one.unseen.q, one.heavy.q)


def test_speeds_and_accelerations_are_derivatives_of_the_joint_values(study, one):
    for value, slope in ((one.heavy.q, one.heavy.qd), (one.heavy.qd, one.heavy.qdd)):
        found = np.gradient(value, 1.0 / study.RATE, axis=0)[2:-2]
        assert np.abs(found - slope[2:-2]).max() < 5e-3 * np.abs(slope).max()


def test_the_payload_is_all_that_differs_between_the_two_motions(one):
    """At the base, whose axis is upright, weight makes no torque: the payload adds none at rest."""
    extra = one.heavy.torque - one.light.torque
    still = np.abs(one.heavy.qd).max(axis=1).argmin()
    assert np.array_equal(one.heavy.q, one.light.q)
    assert np.abs(extra[:, 1]).max() > 1.0 > abs(extra[still, 0])


def test_noise_has_the_stated_size_and_memory(study, one):
    noise = (one.seen[0].torque - one.heavy.torque) / study.NOISE
    assert noise.std() == pytest.approx(1.0, abs=0.03)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(0.7, abs=0.03)


def test_bristles_hold_their_level_where_speed_is_constant(study):
    from drive_cases import _bristles

    found = _bristles(np.full((200, 1), 1.0), np.array([4.0]))
    assert found[-1, 0] == pytest.approx(4.0, rel=1e-6)  # far above the dip: Coulomb alone


def test_ours_predicts_held_out_torques_and_friction(study, one):
    row = study.judged(one, study.wrenchbed(1))
    assert max(row.clean) < 0.03 < max(row.noisy)
    assert row.held >= 14 and row.of == 18
    off, _, half = row.payload
    assert abs(off) < 2.0 * half < 0.2
    text = study.table({"wrenchbed": [row]})
    assert f"{row.held / row.of:.1%}".replace("%", " %") in text and text.count("\n") == 2


def test_what_sysid_gets_is_the_motion_and_its_torques(study, one):
    """Friction by the decimated sign is what is left of the torque without a rigid body's."""
    thin, sign = study.smoothed(one.seen[0])
    rows = np.searchsorted(one.heavy.t, thin.t)
    assert np.abs(thin.qd - one.heavy.qd[rows]).max() < 0.01
    assert np.abs(thin.qdd - one.heavy.qdd[rows]).max() < 0.1
    assert len(thin.t) == len(sign) == len(thin.torque)
    away = np.abs(thin.qd) > 0.5 * np.abs(thin.qd).max(axis=0)
    assert np.abs(sign - np.sign(thin.qd))[away].max() < 0.3
