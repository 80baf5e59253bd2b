"""Ready maps, on files in the form that their programs document or their libraries write."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation, Slerp

import wrenchbed as wb
from wrenchbed.data.column_map import ready
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


def test_a_franka_log_in_the_names_of_libfranka(tmp_path):
    pose = np.tile(np.eye(4), (len(T), 1, 1))
    pose[:, :3, :3] = TURN.as_matrix()
    columns = np.swapaxes(pose, 1, 2).reshape(len(T), 16)
    names = ["time", *(f"O_T_EE[{k}]" for k in range(16))]
    names += [f"K_F_ext_hat_K[{k}]" for k in range(6)]
    rows = [
        [(t - START) // 10**6, *p, *w] for t, p, w in zip(T.tolist(), columns, LOAD, strict=True)
    ]
    came(import_files([save(tmp_path / "log.csv", names, rows)], wb.read_map("franka-csv")))


FRANKA = """std_msgs/Header header
float64[6] K_F_ext_hat_K
float64[16] O_T_EE
"""


def test_a_franka_log_of_ros(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "franka_msgs/msg/FrankaState"
    store.register(get_types_from_msg(FRANKA, kind))
    state, header = store.types[kind], store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    with Writer1(tmp_path / "log.bag") as writer:
        channel = writer.add_connection(
            "/franka_state_controller/franka_states", kind, typestore=store
        )
        for k, at in enumerate(T.tolist()):
            pose = np.eye(4)
            pose[:3, :3] = TURN[k].as_matrix()
            head = header(seq=k, stamp=time(sec=at // 10**9, nanosec=at % 10**9), frame_id="")
            told = state(header=head, K_F_ext_hat_K=LOAD[k], O_T_EE=pose.T.ravel())
            writer.write(channel, at, store.serialize_ros1(told, kind))
    came(import_files([tmp_path / "log.bag"], wb.read_map("franka-ros")))


def test_a_log_with_transforms(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    known = store.types
    time, header = known["builtin_interfaces/msg/Time"], known["std_msgs/msg/Header"]
    vector, quaternion = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Quaternion"]
    wrench, stamped = known["geometry_msgs/msg/Wrench"], known["geometry_msgs/msg/WrenchStamped"]
    turned, moved = (
        known["geometry_msgs/msg/Transform"],
        known["geometry_msgs/msg/TransformStamped"],
    )
    tf = known["tf2_msgs/msg/TFMessage"]
    with Writer2(tmp_path / "log", version=9) as writer:
        loads = writer.add_connection("/wrench", stamped.__msgtype__, typestore=store)
        turns = writer.add_connection("/tf", tf.__msgtype__, typestore=store)
        for k, at in enumerate(T.tolist()):
            head = header(stamp=time(sec=at // 10**9, nanosec=at % 10**9), frame_id="base")
            force, torque = (vector(*map(float, p)) for p in np.split(LOAD[k], 2))
            told = stamped(header=head, wrench=wrench(force=force, torque=torque))
            writer.write(loads, at, store.serialize_cdr(told, stamped.__msgtype__))
            q = turned(vector(0.0, 0.0, 0.5), quaternion(*map(float, TURN[k].as_quat())))
            other = turned(vector(0.0, 0.0, 0.0), quaternion(0.0, 0.0, 0.0, 1.0))
            some = [moved(head, "shoulder", other), moved(head, "tool0", q)]
            for message in (tf(some[: 1 + (k % 2)]), tf(some[1:])):  # some without the tool
                if len(message.transforms) == 1 or k % 2 == 0:
                    writer.write(turns, at, store.serialize_cdr(message, tf.__msgtype__))
    came(import_files([tmp_path / "log"], wb.read_map("ros-tf")))


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
    found = import_files(files, _dynamic(mapping)).recording
    assert found.joints == tuple(f"q{j}" for j in range(1, 8))
    wanted = np.interp(found.t + 0.003, np.arange(len(T)) / RATE, joints[:, 2])
    assert np.abs(found.q[:, 2] - wanted).max() < 1e-9


def _dynamic(mapping):
    from dataclasses import replace

    return replace(mapping, mode="dynamic")


def test_every_ready_map_is_tried():
    here = {"franka-csv", "franka-ros", "ros-tf", "kuka-fri"}
    in_test_logs = {"ur-rtde-current", "ros-ur5", "ros-oriented", "ur-rtde", "ur-client"}
    assert set(ready()) == here | in_test_logs
