"""The arena runs a catalogue on files that its user brings, and judges by what is known of them."""

import sys
from pathlib import Path

import pytest

from wrenchbed.benchmark import arena

DATA = Path(__file__).parents[1] / "data"
SETS = f"""[shared]
repository = "ntnu_kuka_ati_gamma"
commit = "0123abcd"
laboratory = "NTNU"
robot = "KUKA"
channels = "wrench"
known = "0.932 kg"
write."map.toml" = {{ file = "{DATA}/ntnu_kuka_ati_gamma/static.toml" }}
[[set]]
id = "load"
files = {{ "0-calibration_fts-accel.csv" = "" }}
run = [
  "import files/0-calibration_fts-accel.csv --map map.toml --out a.parquet", "calibrate a.parquet"
]
right.values = {{ "tool.mass" = [0.932, 0.01] }}
"""
ENTRANT = f"""{sys.executable} -c '
import json, os, sys
os.mkdir(sys.argv[3])
claim = dict(effect="tool.mass", probability=0.95, rivals=["sensor.gain"])
json.dump(dict(verdict="identified", which=[claim]), open(sys.argv[3] + "/diagnosis.json", "w"))'"""


def answered(folder, text=SETS, *options):
    (folder / "sets.toml").write_text(text)
    code = arena.main([str(folder / "sets.toml"), str(DATA), str(folder / "out"), *options])
    return code, (folder / "out" / "page" / "arena.md").read_text()


def test_a_set_is_answered_once_and_judged_by_what_is_known(tmp_path):
    code, page = answered(tmp_path)
    assert code == 0 and "1 right" in page and "tool.mass 0.93" in page
    kept = tmp_path / "out" / "answers" / "load.json"
    kept.write_text(kept.read_text().replace('"value": 0.93', '"value": 0.73', 1))
    assert "1 wrong" in answered(tmp_path)[1]  # judged anew, not answered anew
    code, page = answered(tmp_path, SETS.replace("import files/0", "import files/9"))
    assert code == 1 and "1 refused" in page and "found none" in page
    asked = SETS.replace('"calibrate', '"diagnose').partition("right.")[0]
    page = answered(tmp_path, asked + 'right.causes = ["sensor.gain"]', "--method", ENTRANT)[1]
    assert "**1 of 1 right**" in page


def test_what_nobody_brought_is_named_with_its_commit(tmp_path):
    other = SETS.replace('.csv" = ""', '.csv" = "0000"')
    assert "another version than that of 0123abcd" in answered(tmp_path, other)[1]
    code, page = answered(tmp_path, SETS.replace('{ "0-', '{ "9-'))
    assert code == 0 and "bring ntnu_kuka_ati_gamma at 0123abcd" in page


@pytest.mark.parametrize("text, options, words", [
    (SETS + SETS[SETS.index("[[set]]") :], (), "two sets are called 'load'"),
    (SETS.replace("commit", "comit"), (), "set 'load': lacks commit"),
    (SETS, ("--only", "lod"), "--only lod: no such set; did you mean 'load'?"),
])  # fmt: skip
def test_a_catalogue_that_is_wrong_is_one_line(tmp_path, capsys, text, options, words):
    (tmp_path / "sets.toml").write_text(text)
    line = [str(tmp_path / "sets.toml"), str(DATA), str(tmp_path / "out"), *options]
    assert arena.main(line) == 1
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1


@pytest.mark.parametrize("right, which, mark", [
    ({"causes": ["a"]}, [("a", 0.95)], "right"), ({"causes": ["a"]}, [("a", 0.6)], "open"),
    ({"causes": ["a"]}, [], "open"), ({"causes": ["a"]}, [("b", 0.6)], "open"),
    ({"causes": ["a"]}, [("b", 0.95)], "wrong"),
    ({"causes": ["a"]}, [("a", 0.95), ("b", 0.95)], "wrong"),
    ({"causes": ["a"], "besides": ["b"]}, [("a", 0.95), ("b", 0.95)], "right"),
    ({"causes": []}, [("a", 0.95)], "wrong"), ({"causes": []}, [("a", 0.85)], "right"),
    ({"refusal": "clock"}, [("a", 0.95)], "wrong"), ({"values": {"x": ["<", 1.0]}}, [], "wrong"),
    ({"refusal": "clock"}, 1, "right"), ({"refusal": "load"}, 1, "refused"),
    ({"refusal": "clock"}, -1, "crashed"),
])  # fmt: skip
def test_marks_of_claims_and_of_refusals_by_their_exit_code(right, which, mark):
    content, code = None, which
    if isinstance(which, list):
        entries = [{"effect": n, "probability": p, "rivals": []} for n, p in which]
        content, code = {"verdict": "unknown", "which": entries}, 0
    given = {"exit": code, "words": "wrenchbed: error: the clock stands still", "answer": content}
    assert arena.judge(right, given).mark == mark
