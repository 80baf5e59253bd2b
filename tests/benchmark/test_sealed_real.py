"""Real recordings are sealed, too."""

import json
import re

import pytest

from sealed_family import truthful
from wrenchbed.benchmark.sealed import commitments, report
from wrenchbed.benchmark.sealed import score as scoring
from wrenchbed.cli import main
from wrenchbed.data.recording import Recording

TRUTH = """
[[case]]
recording = "tilted.parquet"
kind = "single"
[[case.cause]]
effect = "base.tilt"
true = { x = 0.0087, y = 0.0, a.b = 1.0 }

[[case]]
recording = "plain.parquet"
kind = "none"
"""


@pytest.fixture
def measured(family, tmp_path):
    """Two recordings whose columns and metadata tell more than they should."""
    cases, _, _ = family
    for name, source in (("tilted", "0001"), ("plain", "0002")):
        data = Recording.read(commitments.recording_of(cases, source))
        columns = dict(data.columns) | {"shim": data.t * 0.0 + 3.0}
        extra = {"operator": "put a shim under the base"}
        meta = type(data.metadata)(**{**vars(data.metadata), "extra": extra})
        Recording(meta, columns, name).write(tmp_path / f"{name}.parquet")
    (tmp_path / "truth.toml").write_text(TRUTH)
    return tmp_path


def test_real_recordings_are_sealed_under_numbers_and_scored(measured, capsys):
    line = ["blind", "seal", str(measured / "truth.toml"), "--out", str(measured / "c")]
    assert main([*line, "--answers", str(measured / "a"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["commitments"]
    sealed = commitments.verify(measured / "c", measured / "a")
    assert list(sealed) == ["0001", "0002"]
    for name in sealed:
        found = Recording.read(commitments.recording_of(measured / "c", name))
        assert "shim" not in found.columns
        assert found.metadata.extra == {} and found.metadata.source is None
    truthful(measured / "c", measured / "a", measured / "claims" / "me")
    score = scoring.score(measured / "c", measured / "claims", measured / "a")
    told = report.summary(score)
    assert told["me"]["isolation"]["value"] == 1.0
    assert "oracle" not in told
    assert "nan" not in report.page(score).markdown()
    truths = {a.effects: a.causes for a in score.answers.values()}
    assert truths[("base.tilt",)][0].true == {"x": 0.0087, "y": 0.0, "a.b": 1.0}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"base.tilt"', '"base.tlit"', "base.tlit"),
        ('kind = "single"', 'kind = "pair"', r"has 2 \[\[case.cause\]\], found 1"),
        ('kind = "none"', 'kind = "fine"', "case 2: kind = 'fine'"),
        ('"plain.parquet"', '"gone.parquet"', "no such file"),
        ("x = 0.0087", 'x = "0.5 deg"', "table of numbers"),
        ("[[case.cause]]", "[case.cause]", "double brackets"),
        ("[[case]]", "[[cases]]", "no .*case"),
        ("kind =", "kind", "not valid TOML"),
    ],
)
def test_a_truth_that_is_wrong_is_named(measured, capsys, old, new, said):
    path = measured / "truth.toml"
    path.write_text(path.read_text().replace(old, new))
    line = ["blind", "seal", str(path), "--out", str(measured / "c")]
    assert main([*line, "--answers", str(measured / "a")]) == 1
    assert re.search(said, capsys.readouterr().err.replace("\n", " "))
    assert not (measured / "c" / commitments.COMMITMENTS).exists()
