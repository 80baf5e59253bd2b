"""`wrenchbed view` and its files, and refusals that say what to do."""

import json
import socket
from pathlib import Path

import numpy as np
import pytest

from rrd_file import Rrd
from wrenchbed.cli import main
from wrenchbed.errors import DriverError
from wrenchbed.viewer import show


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    assert main(["plan", "ur5", "--n", "12", "--out", str(folder / "plan.parquet")]) == 0
    record = ["record", "--robot", "ur5", "--plan", str(folder / "plan.parquet"), "--samples", "10"]
    rec, fit = str(folder / "rec.parquet"), str(folder / "fit.json")
    assert main([*record, "--out", rec]) == 0
    assert main(["calibrate", rec, "--out", fit]) == 0
    assert main(["view", rec, "--rrd", str(folder / "r.rrd")]) == 0
    assert main(["view", rec, fit, "--rrd", str(folder / "c.rrd")]) == 0
    return folder


def test_a_picture_shows_what_a_fit_leaves(folder, capsys):
    recorded, fitted = (
        [Rrd(folder / f).values(f"/residual/{c}", "Scalars:scalars") for c in ("fx", "fy", "fz")]
        for f in ("r.rrd", "c.rrd")
    )
    assert np.shape(fitted) == np.shape(recorded)
    assert np.square(fitted).sum() < np.square(recorded).sum()
    out = folder / "v.rrd"
    told = ["view", str(folder / "rec.parquet"), str(folder / "fit.json"), "--rrd", str(out)]
    assert main(told) == 0
    assert f"view → {out}" in capsys.readouterr().out.replace("\n", "")
    assert not list(folder.glob(".*"))


def test_the_viewer_is_told_to_listen_to_this_machine_alone():
    told = show.command("x.rrd")
    assert told[told.index("--bind") + 1] == "127.0.0.1" and told[-1] == "x.rrd"


def test_a_port_that_is_taken_is_named(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    with socket.create_server((show.HOST, 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(DriverError, match=f"port {port} is taken"):
            show.show("x.rrd", port=port)


def test_telemetry_is_off_and_the_users_settings_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with show.quiet() as environment:
        written = list(Path(environment["XDG_CONFIG_HOME"]).rglob("*.json"))
        assert written and json.loads(written[0].read_text())["analytics_enabled"] is False
    assert not list(tmp_path.iterdir())


def refused(capsys, *words):
    assert main(list(map(str, words))) == 1
    return capsys.readouterr().err


def test_refusals_say_what_to_do(folder, capsys, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert "there is no screen" in refused(capsys, "view", folder / "rec.parquet")
    assert "diagnose --out" in refused(capsys, "view", folder)
    assert "picture already" in refused(capsys, "view", folder / "r.rrd", folder / "fit.json")
    assert "picture already" in refused(capsys, "view", folder / "r.rrd", "--rrd", "x.rrd")
    plan = folder / "plan.parquet"
    assert "is a plan" in refused(capsys, "view", plan, folder / "fit.json", "--rrd", "p.rrd")
