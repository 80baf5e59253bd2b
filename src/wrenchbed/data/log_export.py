"""A recording as an MCAP file of ROS 2 messages, for whoever looks at logs with ROS's tools."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.recording import Recording
from wrenchbed.files import atomic_write

WRENCH, JOINTS, TEMPERATURE = "/wrench", "/joint_states", "/temperature"
KEY = "wrenchbed"
"""Metadata record that keeps the recording's own metadata as JSON."""
_FRAME = "sensor"
Message = Callable[[int], Any]
"""The message of a row."""


def write_mcap(recording: Recording, path: str | Path) -> None:
    """Write wrench, joints and temperature as `geometry_msgs` and `sensor_msgs` in CDR.

    Args:
        recording: its time 0 becomes the log's.
        path: of the ``.mcap``.

    Raises:
        MissingExtraError: mcap or rosbags is not installed.
    """
    writer_of = registry.require("mcap.writer", "logs").Writer
    typesys = registry.require("rosbags.typesys", "logs")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    at = np.round(1e9 * recording.t.astype(float)).astype(np.int64)
    with atomic_write(path) as stream:
        writer = writer_of(stream)
        writer.start(profile="ros2", library="wrenchbed")
        channels = []
        for topic, kind, message in _topics(recording, at, store):
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels.append((writer.register_channel(topic, "cdr", schema), kind, message))
        for row, now in enumerate(at.tolist()):
            for channel, kind, message in channels:
                data = bytes(store.serialize_cdr(message(row), kind))
                writer.add_message(channel, now, data, now, row)
        metadata = json.dumps(recording.metadata.to_json(), ensure_ascii=False)
        writer.add_metadata(KEY, {"json": metadata})
        writer.finish()


def _topics(recording: Recording, at: np.ndarray, store: Any) -> Iterator[tuple[str, str, Message]]:
    """Topic, type and the message of a row, of all that a recording has."""
    known = store.types
    time, header = known["builtin_interfaces/msg/Time"], known["std_msgs/msg/Header"]

    def head(row: int) -> Any:
        seconds, rest = divmod(int(at[row]), 1_000_000_000)
        return header(stamp=time(sec=seconds, nanosec=rest), frame_id=_FRAME)

    values = recording.wrench.astype(float)
    vector = known["geometry_msgs/msg/Vector3"]
    wrench, stamped = known["geometry_msgs/msg/Wrench"], known["geometry_msgs/msg/WrenchStamped"]

    def load(row: int) -> Any:
        force, torque = (vector(*map(float, part)) for part in np.split(values[row], 2))
        return stamped(header=head(row), wrench=wrench(force=force, torque=torque))

    yield WRENCH, "geometry_msgs/msg/WrenchStamped", load
    if recording.joints:
        robot, names = recording.metadata.robot, list(recording.joints)
        if registry.is_known("robots", robot):
            names = list(registry.load("robots", robot).joint_names)
        state, q = known["sensor_msgs/msg/JointState"], recording.q.astype(float)
        none = np.zeros(0)

        def place(row: int) -> Any:
            return state(header=head(row), name=names, position=q[row], velocity=none, effort=none)

        yield JOINTS, "sensor_msgs/msg/JointState", place
    if "temperature" in recording.columns:
        warm = recording.columns["temperature"].astype(float)
        kind = known["sensor_msgs/msg/Temperature"]

        def warmth(row: int) -> Any:
            return kind(header=head(row), temperature=float(warm[row]), variance=0.0)

        yield TEMPERATURE, "sensor_msgs/msg/Temperature", warmth
