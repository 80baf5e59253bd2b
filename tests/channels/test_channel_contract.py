"""What every channel promises; a new file in the folder is found and tested by itself."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import wrenchbed.channels
from plain_ur5 import PlainUr5, poses
from wrenchbed import registry
from wrenchbed.channels.base import PLACING, Channel
from wrenchbed.channels.readings_with_effects import Response, readings, slices
from wrenchbed.data.column_map import UNITS
from wrenchbed.effects.base import STAGES
from wrenchbed.effects.chain import ActiveEffect, effects
from wrenchbed.effects.scene import Scene

UR5 = registry.load("robots", "ur5")
NAMES = registry.names("channels")


@pytest.fixture(params=NAMES)
def channel(request):
    return registry.load("channels", request.param)


def scene(count=30, seed=0):
    q, t = poses(count, np.random.default_rng(seed)), np.arange(count, dtype=float)
    held = np.ones(count, dtype=bool)
    return Scene(UR5, UR5.parameters.nominal, np.array(UR5.gravity), q, t, held)


def usual(effect):
    """An effect at its typical size, in its first variant."""
    variant = effect.variants(scene())[0]
    known = effect.parameters(UR5)
    size = {n: known[known.index(n)].tolerance for n in effect.usual(variant)}
    return ActiveEffect.of(UR5, effect.name, {**variant.at, **size})


def acting(stages):
    every = (e for e in effects().values() if set(e.stages) <= stages and e.acts(scene()))
    return [usual(e) for e in every if e.variants(scene())]


def test_a_file_is_short(channel):
    module = type(channel).__module__.rpartition(".")[2]
    file = Path(wrenchbed.channels.__path__[0]) / f"{module}.py"
    assert file.read_text(encoding="utf-8").count("\n") <= 150


def test_channels_say_what_they_are_and_share_no_columns(channel):
    assert channel.name in NAMES and channel.title and "\n" not in channel.title
    assert channel.columns and set(channel.columns.values()) <= set(UNITS)
    assert PLACING & channel.stages and channel.stages <= set(STAGES)
    assert channel.modes and set(channel.modes) <= {"static", "dynamic"}
    every = [c for name in NAMES for c in registry.load("channels", name).columns]
    assert len(every) == len(set(every))


def test_it_applies_where_its_columns_are(channel):
    recording = PlainUr5().recording(0, count=12)
    assert channel.applies(recording) == (set(channel.columns) <= set(recording.columns))
    for column in channel.columns:
        bare = {k: v for k, v in recording.columns.items() if k != column}
        less = SimpleNamespace(columns=bare, metadata=recording.metadata, joints=recording.joints)
        assert not channel.applies(less)


def test_only_its_stages_change_it(channel):
    rows, others = scene(), set(STAGES) - channel.stages
    nominal = readings((channel,), rows)
    for active in acting(others):
        assert readings((channel,), rows, [active]) == pytest.approx(nominal, abs=1e-12)


def test_an_offset_of_a_joint_changes_it_by_its_slope(channel):
    rows, offset = scene(), registry.load("effects", "joint.offset")
    known = {p.name: p for p in offset.parameters(UR5)}
    slope = Response(rows, (channel,)).tangent(offset, known["offset.q3"], offset.variants(rows)[2])
    ends = [
        readings((channel,), rows, [ActiveEffect.of(UR5, "joint.offset", {"offset.q3": x})])
        for x in (0.5 * offset.sizes[0], -0.5 * offset.sizes[0])
    ]
    assert slope == pytest.approx(ends[0] - ends[1], abs=1e-4 * np.abs(slope).max())


def test_all_channels_together_read_what_each_reads_alone():
    rows, every = scene(), [registry.load("channels", n) for n in NAMES]
    active = acting({"joint"})[:1]
    together = readings(every, rows, active)
    for channel, of in zip(every, slices(every), strict=True):
        assert together[:, of] == pytest.approx(readings((channel,), rows, active))
    tilt = registry.load("effects", "base.tilt")
    known = {p.name: p for p in tilt.parameters(UR5)}
    whole = Response(rows, tuple(every)).tangent(tilt, known["x"], tilt.variants(rows)[0])
    assert all(np.abs(whole[:, of]).max() > 0.0 for of in slices(every))


def test_nuisance_is_found_again(channel):
    """Readings with other nuisance parameters are fitted by them."""
    rows = scene()
    slopes = channel.nuisance(rows)
    if not slopes.shape[2]:
        return
    rng = np.random.default_rng(1)
    size = 1e-3 / np.abs(slopes).max(axis=(0, 1))
    read = readings((channel,), rows) + slopes @ (size * rng.standard_normal(slopes.shape[2]))
    fitted = channel.fitted(read, rows)
    assert readings((fitted,), rows) == pytest.approx(read, abs=1e-5)


def test_readings_of_a_dead_sensor_are_not_fitted_away(channel):
    """What repeats one value at all poses is refused, or is far from what the fit reads."""
    if type(channel).rows is not Channel.rows:
        return  # readings are differences of columns
    rows = scene()
    dead = np.full((len(rows), len(channel.columns)), 1.0)
    fitted = channel.fitted(dead, rows)
    if fitted is not None:
        far = np.abs(readings((fitted,), rows) - dead).max()
        assert far > 0.01 * np.abs(readings((channel,), rows)).max()
