"""Ready maps, on files in the form that their programs document or their libraries write."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

import wrenchbed as wb
from json_logs import json_log
from wrenchbed.data.import_files import import_files

HOLDS = 5
RATE = 50.0
START = 1_700_000_000_000_000_000
_KEYS = Rotation.random(HOLDS, rng=np.random.default_rng(5))


def log(rows_at_rest=40, rows_of_move=30):
    """Times (N,) [ns], orientations (N,) and wrenches (N, 6) of holds and moves."""
    place = []
    for k in range(HOLDS):
        place += [float(k)] * rows_at_rest
        if k < HOLDS - 1:
            s = np.linspace(0.0, 1.0, rows_of_move)
            place += list(k + s**2 * (3 - 2 * s))
    turn = Slerp(np.arange(HOLDS), _KEYS)(np.clip(place, 0, HOLDS - 1))
    force = turn.inv().apply([0.0, 0.0, -12.0])
    load = np.hstack([force, np.cross([0.0, 0.01, 0.05], force)])
    load += 0.01 * np.random.default_rng(1).normal(size=load.shape)
    t = START + (np.arange(len(place)) * 1e9 / RATE).astype(np.int64)
    return t, turn, load


T, TURN, LOAD = log()


def save(path, names, rows, before=()):
    lines = [*before, ",".join(names), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def came(imported) -> None:
    """All holds were found, with the orientation and wrench that were written."""
    assert len(imported.split.seconds) == HOLDS
    motion = imported.motion
    rows = len(motion)
    assert np.abs(motion.rotation - TURN[:rows].as_matrix()).max() < 1e-6
    assert np.abs(motion.wrench - LOAD[:rows]).max() < 1e-6


def test_franka_logs_in_the_names_of_libfranka_and_of_ros(tmp_path):
    pose = np.tile(np.eye(4), (len(T), 1, 1))
    pose[:, :3, :3] = TURN.as_matrix()
    columns = np.swapaxes(pose, 1, 2).reshape(len(T), 16)
    names = ["time", *(f"O_T_EE[{k}]" for k in range(16))]
    names += [f"K_F_ext_hat_K[{k}]" for k in range(6)]
    rows = [
        [(t - START) // 10**6, *p, *w] for t, p, w in zip(T.tolist(), columns, LOAD, strict=True)
    ]
    came(import_files([save(tmp_path / "log.csv", names, rows)], wb.read_map("franka-csv")))
    states = (
        {"header": head(at), "K_F_ext_hat_K": load.tolist(), "O_T_EE": matrix.T.ravel().tolist()}
        for at, load, matrix in zip(T.tolist(), LOAD, pose, strict=True)
    )
    topics = ["/franka_state_controller/franka_states"] * len(T)
    json_log(tmp_path / "a.mcap", zip(topics, states, T.tolist(), strict=True))
    came(import_files([tmp_path / "a.mcap"], wb.read_map("franka-ros")))


def head(at):
    return {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}}


def test_a_log_with_transforms(tmp_path):
    def messages():
        for k, (at, load) in enumerate(zip(T.tolist(), LOAD.tolist(), strict=True)):
            force, torque = (dict(zip("xyz", part, strict=True)) for part in (load[:3], load[3:]))
            yield "/wrench", {"header": head(at), "wrench": {"force": force, "torque": torque}}, at
            turns = {"shoulder": [0.0, 0.0, 0.0, 1.0], "tool0": TURN[k].as_quat().tolist()}
            some = [
                {"header": head(at), "child_frame_id": name,
                 "transform": {"rotation": dict(zip("xyzw", q, strict=True))}}
                for name, q in turns.items()
            ]  # fmt: skip
            yield "/tf", {"transforms": some[: 1 + (k % 2)]}, at  # some without the tool
            if k % 2 == 0:
                yield "/tf", {"transforms": some[1:]}, at

    json_log(tmp_path / "a.mcap", messages())
    came(import_files([tmp_path / "a.mcap"], wb.read_map("ros-tf")))


def test_a_kuka_log_of_fri_beside_the_sensors_own(tmp_path):
    joints = np.stack([np.sin(np.arange(len(T)) / 90.0 + j) for j in range(7)], axis=1)
    names = ["index", "time", "record_time_nsec", "tsec", "tnsec"]
    names += [f"{kind}{j}" for kind in ("mp", "ip", "mt", "et") for j in range(1, 8)] + ["dt"]
    fri = [
        [k, 0.02 * k, t, t // 10**9, t % 10**9, *q, *q, *q, *q, 0.02]
        for k, (t, q) in enumerate(zip(T.tolist(), joints, strict=True))
    ]
    channels = ["fx", "fy", "fz", "tx", "ty", "tz"]
    wrench = [[t + 3_000_000, *w] for t, w in zip(T.tolist(), LOAD, strict=True)]
    files = [save(tmp_path / "run_fri.csv", names, fri)]
    files.append(save(tmp_path / "run_wrench.csv", ["t", *channels], wrench))
    mapping = wb.read_map("kuka-fri")
    found = import_files(files, replace(mapping, mode="dynamic")).recording
    assert found.joints == tuple(f"q{j}" for j in range(1, 8))
    wanted = np.sin((found.t + 0.003) * RATE / 90.0 + 2.0)
    assert np.abs(found.q[:, 2] - wanted).max() < 1e-6  # a straight line is off by 8e-6
