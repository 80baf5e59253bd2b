"""Lags, encoders and slides: what their columns in a diagnosis of efforts are and are not."""

import loop_torques as loops
import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from wrenchbed.cli import main
from wrenchbed.diagnosis.efforts.columns import of_joint, rows_of
from wrenchbed.diagnosis.efforts.scene import effort_scene
from wrenchbed.diagnosis.efforts.stated_drives import stated_drives
from wrenchbed.drives.signals import motion_signals
from wrenchbed.effects.drives.delay_fit import closest

RATE = 100.0
T = np.arange(4000) / RATE
SPEED = np.cos(2.0 * T) + 0.5 * np.cos(3.1 * T)


@pytest.mark.parametrize("late", [0.0245, 0.0640, 0.104])
def test_a_delay_between_those_tried_is_found(late):
    rng = np.random.default_rng(4)

    def torque(t):
        return 5.0 * np.tanh((np.cos(2.0 * t) + 0.5 * np.cos(3.1 * t)) / 0.02) + 9.0 * np.sin(t)

    def change(time):
        return np.interp(T - time, T, torque(T)) - torque(T)

    y = torque(T - late) - torque(T) + 0.05 * SPEED + 0.2 * rng.normal(size=len(T))
    beside = np.column_stack([SPEED, np.ones_like(T)])
    found = closest(lambda time: [change(time)], y, np.linalg.qr(beside)[0])
    assert found == pytest.approx(late, abs=1.5e-3)


def test_an_encoder_of_17_bits_makes_no_acceleration():
    rng = np.random.default_rng(5)
    step = 2.0 * np.pi / 2**17
    true = 0.3 * np.sin(2.0 * T)
    q = np.round((true + 0.3 * step * rng.normal(size=T.shape)) / step) * step
    signals = motion_signals("test", T, q[:, None], q[:, None], 5.0)
    inner = slice(200, -200)
    off = (signals.q.dd[:, 0] + 4.0 * true)[inner]
    plain = sosfiltfilt(butter(4, 20.0, fs=RATE, output="sos"), q)
    rough = np.gradient(np.gradient(plain, T), T)[inner] + 4.0 * true[inner]
    assert off.std() < 5e-3 < 0.2 * rough.std()  # [rad/s²]


@pytest.fixture
def recording():
    t, q = loops.fourier(np.random.default_rng(1), 10.0)
    effort = loops.torques(q, loops.MASS, loops.MEDRUE.gravity)
    return loops.recording(t, q, effort, configured=loops.DRIVES)


def test_a_slide_has_no_spring_that_turns(recording):
    scene = effort_scene(recording, stated_drives(recording))
    effects = [{b.effect for b in of_joint(scene, rows_of(scene, j))[1]} for j in range(2)]
    assert effects[1] - effects[0] == {"link.spring"} and not effects[0] - effects[1]


def test_the_verb_answers_nothing_that_does_not_hold_over_the_wire(recording, tmp_path, capsys):
    recording.write(tmp_path / "rec.parquet")
    assert main(["diagnose", str(tmp_path / "rec.parquet"), "--out", str(tmp_path / "out")]) == 1
    assert "has closed loops" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
