"""A robot's log as bags of ROS 1 and 2: wrench, joints, orientation, acceleration, temperature."""

from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

RATE, COUNT = 100.0, 60
START = 1_700_000_000_123_456_789
UR = ("elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint", "wrist_1_joint",
      "wrist_2_joint", "wrist_3_joint")  # fmt: skip
"""In the order of the alphabet, as UR's driver publishes them."""
ORDER = (2, 1, 0, 3, 4, 5)
"""Of the robot's joints among these."""
RNG = np.random.default_rng(3)
LOAD, Q = RNG.normal(size=(COUNT, 6)), np.cumsum(RNG.normal(0, 1e-3, (COUNT, 6)), axis=0)
TURN = RNG.normal(size=4) / 3


def stamps():
    return START + (1e9 / RATE * np.arange(COUNT)).astype(int)


def messages(store, ros1=False):
    """(topic, type, message, time [ns]) of a robot's log."""
    known = store.types
    time, header = known["builtin_interfaces/msg/Time"], known["std_msgs/msg/Header"]
    vector, quaternion = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Quaternion"]
    wrench, stamped = known["geometry_msgs/msg/Wrench"], known["geometry_msgs/msg/WrenchStamped"]
    state, imu = known["sensor_msgs/msg/JointState"], known["sensor_msgs/msg/Imu"]
    warm, nine, none = known["sensor_msgs/msg/Temperature"], np.zeros(9), np.zeros(0)
    unit = TURN / np.linalg.norm(TURN)
    for k, at in enumerate(stamps().tolist()):
        stamp = time(sec=at // 10**9, nanosec=at % 10**9)
        own = {"seq": k} if ros1 else {}
        head = header(stamp=stamp, frame_id="tool0", **own)
        force, torque = (vector(*map(float, p)) for p in np.split(LOAD[k], 2))
        yield "/wrench", "geometry_msgs/msg/WrenchStamped", stamped(
            header=head, wrench=wrench(force=force, torque=torque)
        ), at + 5_000  # fmt: skip
        place = np.array([Q[k][list(ORDER).index(j)] for j in range(6)])
        yield "/joint_states", "sensor_msgs/msg/JointState", state(
            header=head, name=list(UR), position=place, velocity=none, effort=none
        ), at + 6_000  # fmt: skip
        yield "/imu", "sensor_msgs/msg/Imu", imu(
            header=head, orientation=quaternion(*map(float, [*unit[1:], unit[0]])),
            orientation_covariance=nine, angular_velocity=vector(0.0, 0.0, 0.0),
            angular_velocity_covariance=nine,
            linear_acceleration=vector(0.1, 0.2, 9.8), linear_acceleration_covariance=nine,
        ), at + 7_000  # fmt: skip
        yield "/temperature", "sensor_msgs/msg/Temperature", warm(
            header=head, temperature=20.0 + k / 10, variance=0.0
        ), at + 8_000  # fmt: skip


def fill(writer: Writer1 | Writer2, only: str = "") -> None:
    """Write the messages of all topics or of one."""
    ros1 = isinstance(writer, Writer1)
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    serialized, channels = store.serialize_ros1 if ros1 else store.serialize_cdr, {}
    with writer:
        for topic, kind, message, at in messages(store, ros1):
            if only in ("", topic):
                if topic not in channels:
                    channels[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(channels[topic], at, serialized(message, kind))


def bag1(path: Path) -> Path:
    fill(Writer1(path / "log.bag"))
    return path / "log.bag"


def bag2(path: Path, storage=StoragePlugin.SQLITE3) -> Path:
    fill(Writer2(path / "log", version=9, storage_plugin=storage))
    return path / "log"


def plain(thing):
    if isinstance(thing, np.ndarray):
        return thing.tolist()
    if hasattr(thing, "__dataclass_fields__"):
        return {k: plain(getattr(thing, k)) for k in thing.__dataclass_fields__ if k[0] != "_"}
    return thing
