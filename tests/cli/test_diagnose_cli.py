"""What `wrenchbed diagnose` learns before it answers, and what its probabilities rest on."""

import json
from dataclasses import replace

import numpy as np
import pytest

import mutated
from wrenchbed.benchmark.scoring import at_design
from wrenchbed.cli import main
from wrenchbed.cli.diagnose import material_of
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.explain.reliability import shipped
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.errors import ParameterError
from wrenchbed.pages.draw import Drawn


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
        return replace(shipped(), source="a test's cases")

    monkeypatch.setattr(at_design, "reliability_at_design", learn)
    monkeypatch.setattr("wrenchbed.reports.diagnosis_page.draw", lambda c: Drawn(c, "<svg></svg>"))
    return counts


@pytest.mark.sampled
@pytest.mark.parametrize(("flags", "counts"), [([], []), (["--look-alikes", "30"], [30])])
def test_look_alikes_are_learnt_where_they_are_asked_for(oriented, asked, flags, counts, capsys):
    """What is unlike all cases that taught is said, and no claim is surer than on real robots."""
    out = oriented.parent / "out"
    assert main(["diagnose", str(oriented), "--out", str(out), *flags]) == 0
    assert asked == counts
    printed = " ".join(capsys.readouterr().out.split())
    assert ("learnt on a test's cases" in printed) == bool(counts)
    assert "which this recording is unlike: claims are believed to 85 % at most" in printed
    answer = json.loads((out / "diagnosis.json").read_text())
    assert answer["familiar"]["p_value"] < 0.01
    assert answer["familiar"]["sentence"] in printed
    assert all(w["probability"] <= 0.85 for w in answer["which"])


def test_nothing_is_learnt_before_a_recording_is_refused(oriented, asked, capsys):
    few = oriented.parent / "few.parquet"
    recording = Recording.read(oriented)
    keep = np.arange(len(recording.t)) < 8
    columns = {name: x[keep] for name, x in recording.columns.items()}
    replace(recording, columns=columns).write(few)
    assert (
        main(["diagnose", str(few), "--out", str(oriented.parent / "out"), "--look-alikes", "30"])
        == 1
    )
    assert asked == []
    assert "less than 5 s of motion" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.2N, 0.01 N·m", Material(0.2, 0.01)),
        ("0.1mm", Material(place=1e-4)),
        (".5Nm,2e-1N,0.05mm", Material(0.2, 0.5, 5e-5)),
        ("0.2N,0.3N", None),
        ("0N", None),
        ("1e999mm", None),
        ("0.2kg", None),
        ("0.1mm,", None),
    ],
)
def test_what_is_material_has_a_unit(text, expected):
    if expected is not None:
        assert material_of(text) == pytest.approx(expected)
        return
    with pytest.raises(ParameterError, match=r"as 0.2N,0.01N·m,0.1mm"):
        material_of(text)
