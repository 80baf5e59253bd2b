"""What `wrenchbed import` says of a recording that no calibration would take."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

from simulated import UR5_TRUTH, WHITE, static
from wrenchbed.cli import main
from wrenchbed.physics.wrench import CHANNELS

MAP = """
[recording]
robot = "ur5"
mode = "static"

[[file]]
match = "*"
[file.columns]
t = { column = "t", unit = "s" }
segment = { column = "segment" }
"""
MAP += "".join(f'q{j} = {{ column = "q{j}", unit = "rad" }}\n' for j in range(1, 7))
MAP += "".join(
    f'{c} = {{ column = "{c}", unit = "{"N" if c[0] == "f" else "N·m"}" }}\n' for c in CHANNELS
)


@pytest.mark.parametrize("broken", [False, True])
def test_a_doubt_is_said_and_the_recording_written(tmp_path, capsys, broken):
    columns = dict(static("ur5", UR5_TRUTH, poses=30, samples=5, noise=WHITE).columns)
    if broken:
        columns["fx"], columns["fz"] = columns["fz"], columns["fx"]
    pa.csv.write_csv(pa.table({k: np.asarray(x) for k, x in columns.items()}), tmp_path / "a.csv")
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    out = tmp_path / "rec.parquet"
    command = ["import", str(tmp_path / "a.csv"), "--map", str(tmp_path / "map.toml")]
    assert main([*command, "--out", str(out), "--json"]) == 0
    told = capsys.readouterr()
    assert out.exists()
    assert ("doubt" in json.loads(told.out)) == broken
    assert ("calibrate will refuse" in told.err) == broken
    assert main(["calibrate", str(out)]) == (1 if broken else 0)
    if broken:
        assert json.loads(told.out)["doubt"] in capsys.readouterr().err
