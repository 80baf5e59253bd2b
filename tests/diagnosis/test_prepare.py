"""How a recording is split, averaged and weighed before the analysis."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchbed.calibration.observations import Observations, scatter
from wrenchbed.diagnosis.prepare import prepare_recording as module
from wrenchbed.diagnosis.prepare.prepared import Prepared, inner_stride, split
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.wrench import CHANNELS


def prepared(rows=16, stride=1, moving=False, source="stated"):
    """Observations in blocks of four, the second of which is sealed; readings count up."""
    block = np.arange(rows) // 4
    scene = SimpleNamespace(held=np.ones(rows, dtype=bool), moving=moving, q=np.arange(rows))
    return Prepared(
        None, None, _Long(scene, rows), np.zeros((rows, 6)), np.ones(rows),
        np.diag(np.array([1.0, 0.5, 0.2, 1.0, 1.0, 0.1]) ** 2), np.full(6, 3.0), source, block,
        block == 1, np.zeros((rows, 6, 6)), 0, stride,
    )  # fmt: skip


class _Long(SimpleNamespace):
    def __init__(self, scene, rows):
        super().__init__(**vars(scene))
        self._rows = rows

    def __len__(self):
        return self._rows


def counting(rows=16):
    return np.arange(float(rows))[:, None] * np.ones(6)


def test_rows_are_whitened_channel_by_channel_and_sealed_ones_kept_apart():
    p = prepared()
    told = p.rows(counting())
    assert told[:, 0] == pytest.approx([0, 1, 2, 3, *range(8, 16)])
    assert told[:, 5] == pytest.approx(10.0 * told[:, 0])
    assert p.rows(counting(), sealed=True)[:, 1] == pytest.approx([8, 10, 12, 14])
    assert list(p.block_rows) == [0] * 4 + [2] * 4 + [3] * 4
    assert p.variance == pytest.approx(np.full(6, 3.0))


def test_a_motion_is_averaged_within_its_blocks():
    p = prepared(stride=3, moving=True)
    told = p.rows(counting())
    assert told[:, 0] == pytest.approx([1.0, 9.0, 13.0])  # the fourth row of each is left over
    assert list(p.block_rows) == [0, 2, 3]
    assert p.variance == pytest.approx(np.full(6, 1.0))
    pairs = prepared(stride=2)
    assert pairs.rows(counting())[:, 0] == pytest.approx([0.5, 2.5, 8.5, 10.5, 12.5, 14.5])
    assert list(pairs.block_rows) == [0, 0, 2, 2, 3, 3]


@pytest.mark.parametrize("seed", range(4))
def test_one_of_every_four_poses_is_sealed(seed):
    block, sealed = split(43, False, seed, 1)
    assert list(block) == list(range(43))
    chosen = np.flatnonzero(sealed)
    assert [k // 4 for k in chosen[:10]] == list(range(10))
    assert len(chosen) in (10, 11)
    again = split(43, False, seed, 1)[1]
    assert (again == sealed).all()


def test_the_seed_says_which_are_sealed():
    assert (split(43, False, 0, 1)[1] != split(43, False, 1, 1)[1]).any()


def test_a_motion_has_24_blocks_of_whole_strides():
    block, sealed = split(2405, True, 0, 10)
    assert block.max() == 23
    lengths = np.bincount(block)
    assert (lengths[:-1] == 100).all() and lengths[-1] == 105
    chosen = np.unique(block[sealed])
    assert [b // 4 for b in chosen] == list(range(6))
    assert (np.isin(block, chosen) == sealed).all()
    short, _ = split(5, True, 0, 10)  # less than one stride
    assert set(short) == {0}


@pytest.mark.parametrize(("stride", "inner"), [(1, 1), (3, 1), (4, 1), (8, 2), (13, 3)])
def test_an_average_is_of_at_least_four_pieces(stride, inner):
    assert inner_stride(stride) == inner


@pytest.mark.parametrize(
    ("source", "told"), [("stated", "as stated"), ("repeats", "from its repeats")]
)
def test_people_are_told_where_the_noise_is_from(source, told):
    assert prepared(source=source).noise_source == told


def test_noise_of_a_row_is_from_repeats_or_stated_or_refused():
    data = SimpleNamespace(source="repeats", row_covariance=2.0 * np.eye(6))
    covariance, source = module._row_noise(SimpleNamespace(name="r"), data, None)
    assert (covariance == 2.0 * np.eye(6)).all() and source == "repeats"
    with pytest.raises(DiagnosisError, match="cannot tell a gap from noise"):
        refused = SimpleNamespace(source="residual")
        module._row_noise(SimpleNamespace(name="r"), refused, None)


@pytest.mark.parametrize(("time", "expected"), [(1.0, 0.125), (4.0, 0.5), (20.0, 1.0)])
def test_rows_with_memory_average_less(monkeypatch, time, expected):
    monkeypatch.setattr(module, "correlation_time", lambda *_: np.full(6, time))
    data = SimpleNamespace(count=np.array([4, 12]))
    assert module._noise_at_rest(None, data) == pytest.approx(np.full(6, expected))


def test_noise_in_motion_is_never_below_that_of_a_row(monkeypatch):
    told = np.array([0.2, 1.0, 1.5, 3.0, 0.9, 1.1])
    monkeypatch.setattr(module, "noise_in_motion", lambda *_: (np.zeros(6), told))
    assert module._noise_of_averages(None, 0.008, 4) == pytest.approx([1, 1, 1.5, 3.0, 1, 1.1])


def test_joint_values_are_those_of_the_observations():
    p = prepared(4)
    p.scene.held[1] = False
    assert list(p.poses) == [0, 2, 3]


def test_rows_of_a_pose_scatter_about_their_mean_and_rows_of_a_motion_do_not():
    data = Observations(
        None, np.array([np.full(6, 1.0), np.full(6, 5.0)]), np.array([2, 3]), np.eye(6), 1.0,
        "repeats", np.zeros(2), np.ones(5, dtype=bool),
    )  # fmt: skip
    columns = {c: np.array([0.0, 2.0, 5.0, 5.0, 5.0]) for c in CHANNELS}
    columns["tx"] = np.array([1.0, 1.0, 2.0, 5.0, 8.0])
    metadata = SimpleNamespace(mode="static", source="device")
    rec = _Long(SimpleNamespace(metadata=metadata, columns=columns), 5)
    told = scatter(rec, data)
    assert told.shape == (2, 6, 6)
    assert told[0, 0, 1] == told[0, 2, 2] == pytest.approx(1.0)
    assert told[1, 3, 3] == pytest.approx((9.0 + 0.0 + 9.0) / 3.0)
    assert told[1, 0, 0] == told[1, 0, 3] == told[1, 3, 0] == pytest.approx(0.0)
    metadata.mode = "dynamic"
    assert (scatter(rec, data) == np.zeros((2, 6, 6))).all()
