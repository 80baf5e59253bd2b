"""What `wrenchbed diagnose` learns by itself before it answers."""

from dataclasses import replace

import numpy as np
import pytest

import mutated
from wrenchbed.benchmark.scoring import cases as at_design
from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.explain.reliability import shipped
from wrenchbed.errors import DiagnosisError


@pytest.fixture
def oriented(tmp_path):
    """A recording without joints, of a robot that the package does not know."""
    path = tmp_path / "rec.parquet"
    mutated.BASES["turning"](np.random.default_rng(3)).write(path)
    return path


@pytest.fixture
def asked(monkeypatch):
    """How many look-alikes each call wanted."""
    counts = []

    def learn(recording, count, **_):
        counts.append(count)
        return replace(shipped("ur5", moving=False), own=True, source="a test's cases")

    monkeypatch.setattr(at_design, "reliability_at_design", learn)
    return counts


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("flags", "counts"),
    [([], [100]), (["--look-alikes", "30"], [30]), (["--fast"], [])],
)
def test_look_alikes_are_learnt_where_nothing_is_known(oriented, asked, flags, counts, capsys):
    out = oriented.parent / "out"
    assert main(["diagnose", str(oriented), "--out", str(out), *flags]) == 0
    assert asked == counts
    told = " ".join(capsys.readouterr().out.split())
    assert ("learnt on a test's cases" in told) == bool(counts)
    assert ("learnt on other robots and other sets" in told) != bool(counts)


@pytest.mark.slow
def test_a_design_at_which_nothing_can_be_drawn_is_said_and_diagnosed(
    oriented, monkeypatch, capsys
):
    def learn(*_, **__):
        raise DiagnosisError("no case names a cause")

    monkeypatch.setattr(at_design, "reliability_at_design", learn)
    assert main(["diagnose", str(oriented), "--out", str(oriented.parent / "out")]) == 0
    assert "nothing was learnt: no case names a cause" in capsys.readouterr().err


def test_nothing_is_learnt_before_a_recording_is_refused(oriented, asked, capsys):
    few = oriented.parent / "few.parquet"
    recording = Recording.read(oriented)
    keep = np.arange(len(recording.t)) < 8
    columns = {name: x[keep] for name, x in recording.columns.items()}
    replace(recording, columns=columns).write(few)
    assert main(["diagnose", str(few), "--out", str(oriented.parent / "out")]) == 1
    assert asked == []
    assert "less than 5 s of motion" in capsys.readouterr().err


@pytest.mark.slow
def test_a_known_robot_is_diagnosed_at_once(asked, tmp_path):
    path = tmp_path / "rec.parquet"
    mutated.BASES["ur5"](np.random.default_rng(3)).write(path)
    assert main(["diagnose", str(path), "--out", str(tmp_path / "out")]) == 0
    assert asked == []
