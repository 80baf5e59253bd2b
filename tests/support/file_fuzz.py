"""Files of every format that wrenchbed reads, mutated: read right, or refused by a named error.

A target writes one mutated file and reads it. Its seeds are made by the libraries' own writers, so
nothing but inputs that once failed is kept as a file (tests/data/fuzz/<target>/).
"""

import contextlib
import io
import json
import random
import struct
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from recorded import METADATA, columns
from robot_logs import fill, messages, plain
from wrenchbed.data import parquet
from wrenchbed.errors import WrenchbedError, WrenchbedWarning
from wrenchbed.physics.wrench import CHANNELS

CORPUS = Path(__file__).parents[1] / "data" / "fuzz"
WEIRD: tuple[Any, ...] = (
    None, True, "", "x", "\x1b[2J\u202e", "r" * 5000, 0, -1, 1e308, -0.0, 10**400, 2**63, [], {},
    [1.0], [None] * 6, {"a": 1}, ["a"] * 7, float("nan"), float("inf"),
)  # fmt: skip


@dataclass(frozen=True)
class FileTarget:
    """How a mutated file is read: ``read`` returns what a mutation must not change, or None;
    ``seeds`` are contents of good files, ``beside`` further files for each. ``true``: a checksum
    covers what is read; ``structured``: half of the mutations are of the JSON."""

    read: Callable[[Path], Any]
    seeds: Sequence[bytes]
    name: str
    true: bool = False
    beside: Sequence[dict[str, bytes]] = ()
    structured: bool = False


class Runner:
    """Runs one target on bytes, in a folder of its own."""

    def __init__(self, target: FileTarget) -> None:
        self.target = target
        self._folder = tempfile.TemporaryDirectory()
        self.accepted = self.refused = 0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", WrenchbedWarning)
            self._values = [self._read(seed, k) for k, seed in enumerate(target.seeds)]

    def __call__(self, data: bytes) -> None:
        """Read; raises what is no named error, and AssertionError for values that are wrong."""
        self.run(data, 0)

    def run(self, data: bytes, seed: int) -> None:
        """As a mutation of one of the seeds."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", WrenchbedWarning)
                found = self._read(data, seed)
        except WrenchbedError as error:
            text = str(error)
            assert "\n" not in text and "\x1b" not in text and len(text) < 5000, text[:300]
            self.refused += 1
            return
        self.accepted += 1
        if self.target.true:
            assert any(_same(found, value) for value in self._values), "wrong values accepted"

    def _read(self, data: bytes, seed: int) -> Any:
        path = Path(self._folder.name, self.target.name)
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        for name, content in (self.target.beside[seed] if self.target.beside else {}).items():
            (path.parent / name).write_bytes(content)
        return self.target.read(path)

    def close(self) -> None:
        self._folder.cleanup()


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in a)
    return bool(a == b)


def mutated(target: FileTarget, dice: random.Random) -> tuple[bytes, int]:
    """A mutation of one of a target's seeds, and the seed's number."""
    number = dice.randrange(len(target.seeds))
    data = bytearray(target.seeds[number])
    if target.structured and dice.random() < 0.6:
        return _structured(data, dice), number
    for _ in range(dice.choice((1, 1, 1, 2, 4))):
        _change(data, dice, target.seeds)
    return bytes(data), number


def _change(data: bytearray, dice: random.Random, seeds: Sequence[bytes]) -> None:
    """One change of bytes: flip, set, cut, drop, repeat, a number, or a piece of a seed."""
    if not data:
        data += b"\0"
    at = dice.randrange(len(data))
    size = min(dice.choice((1, 2, 4, 8, 40, 300)), len(data) - at)
    other = dice.choice(seeds)
    from_ = dice.randrange(len(other))
    match dice.randrange(9):
        case 0 | 1:
            data[at] ^= 1 << dice.randrange(8)
        case 2:
            data[at] = dice.choice(b'\0\xff\x7f\x80 \n",.-{}[]0e')
        case 3:
            del data[at:]
        case 4:
            del data[at : at + size]
        case 5:
            data[at:at] = data[at : at + size] * dice.choice((1, 2, 50))
        case 6:
            number = dice.choice((0, 1, 255, 2**16, 2**31 - 1, 2**32 - 1, 2**40, 2**63, 2**64 - 1))
            data[at : at + 8] = struct.pack("<Q", number)[: max(1, min(8, len(data) - at))]
        case 7:
            data[at : at + size] = other[from_ : from_ + size]
        case _:
            data[at : at + size] = bytes(size)


def _structured(data: bytes | bytearray, dice: random.Random) -> bytes:
    """JSON with one or two of its values exchanged, dropped or doubled."""
    content = json.loads(data)
    for _ in range(dice.choice((1, 1, 2))):
        part, key = content, None
        while isinstance(part, dict | list) and part:
            keys = list(part) if isinstance(part, dict) else list(range(len(part)))
            above, key = part, dice.choice(keys)
            part = part[key]
            if dice.random() < 0.25:
                break
        if key is None:
            break
        if dice.random() < 0.2:
            del above[key]
        elif dice.random() < 0.1 and isinstance(above, dict):
            above[str(key) + "x"] = above[key]
        else:
            above[key] = json.loads(json.dumps(dice.choice(WEIRD)))
    return json.dumps(content).encode()


def corpus(name: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((CORPUS / name).glob("*"))]


MAP = """[recording]
robot = "mine"
mode = "dynamic"
[orientation]
constant = [1.0, 0.0, 0.0, 0.0]
[[file]]
topic = "/wrench"
[file.columns]
t = { column = "stamp", unit = "ns" }
"""
WRENCH = "geometry_msgs/msg/WrenchStamped"


def _columns(path: Path) -> dict[str, np.ndarray]:
    """As `wrenchbed import` reads a log."""
    import wrenchbed as wb

    units = zip(CHANNELS, ("N",) * 3 + ("Nm",) * 3, strict=True)
    entries = [
        f'{c} = {{ column = "wrench.{"force" if c[0] == "f" else "torque"}.{c[1]}", unit = "{u}" }}'
        for c, u in units
    ]
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder, "map.toml")
        own.write_text(MAP + "\n".join(entries))
        return dict(wb.import_files([path], wb.read_map(own)).recording.columns)


def _mcap(compression: str, *, crcs: bool = True, data_crcs: bool = True,
          encoding: str = "cdr") -> bytes:  # fmt: skip
    from mcap.writer import CompressionType, Writer

    stream, store = io.BytesIO(), get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(stream, compression=CompressionType[compression], chunk_size=900,
                    enable_crcs=crcs, enable_data_crcs=data_crcs)  # fmt: skip
    writer.start(profile="ros2")
    text, _ = store.generate_msgdef(WRENCH, ros_version=2)
    of_cdr, of_json = (WRENCH, "ros2msg", text.encode()), ("any", "jsonschema", b"{}")
    schema = writer.register_schema(*(of_cdr if encoding == "cdr" else of_json))
    topic = writer.register_channel("/wrench", encoding, schema)
    for on, kind, message, at in messages(store):
        if on == "/wrench":
            as_json = json.dumps(plain(message)).encode()
            data = as_json if encoding == "json" else store.serialize_cdr(message, kind)
            writer.add_message(topic, at, bytes(data), at)
    writer.finish()
    return stream.getvalue()


def mcap() -> FileTarget:
    """MCAP files with checksums of chunks, and of the data in one of them."""
    seeds = [_mcap(kind, data_crcs=False) for kind in ("NONE", "LZ4", "ZSTD")]
    return FileTarget(_columns, [*seeds, _mcap("NONE", encoding="json")], "log.mcap", true=True)


def mcap_without_checksums() -> FileTarget:
    """MCAP files without any checksum: what lies deeper is reached."""
    seeds = [_mcap("NONE", crcs=False, data_crcs=False, encoding=e) for e in ("json", "cdr")]
    return FileTarget(_columns, seeds, "log.mcap")


def bag1() -> FileTarget:
    """Bags of ROS 1, plain and compressed. The format has no checksums."""
    seeds = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in (None, *Writer1.CompressionFormat):
            writer = Writer1(path := Path(folder, f"{kind}.bag"))
            if kind is not None:
                writer.set_compression(kind)
            fill(writer, "/wrench")
            seeds.append(path.read_bytes())
    return FileTarget(_columns, seeds, "log.bag")


def _bag2() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        fill(Writer2(Path(folder, "log"), version=9), "/wrench")
        return {p.name: p.read_bytes() for p in Path(folder, "log").iterdir()}


def _of_bag2(name: str) -> FileTarget:
    """One file of a bag of ROS 2. The format has no checksums."""
    bag = _bag2()
    seed = bag.pop(name)
    return FileTarget(lambda path: _columns(path.parent), [seed], f"log/{name}", beside=[bag])


def csv_table() -> FileTarget:
    from wrenchbed.data.guess.guess import guess
    from wrenchbed.data.text_table import read_text

    def read(path: Path) -> None:
        with contextlib.suppress(WrenchbedError):
            guess([path])
        text = read_text(path)
        for name in text.table.column_names[:8]:
            with contextlib.suppress(WrenchbedError):
                text.numbers(name)

    rows = np.random.default_rng(5).normal(size=(30, 7)).round(4)
    plain = "\n".join(",".join(map(str, row)) for row in rows)
    german = "Zeit;Fx;Fy\n" + "\n".join(f"{k};{k},5;-{k},25" for k in range(30))
    quoted = 'a "b",c\n' + "\n".join(f'"{k}","{k}.5"' for k in range(30))
    texts = (f"# note, 3\nt,fx,fy,fz,tx,ty,tz\n{plain}\n", german, quoted, plain.replace(",", "  "))
    seeds = [t.encode() for t in texts] + [german.encode("utf-16"), "µ;N\n1;2\n".encode("cp1252")]
    return FileTarget(read, seeds, "log.csv")


def _parquet(data: dict[str, Any]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.parquet")
        parquet.write(path, parquet.table_of(data, METADATA.to_json()))
        return path.read_bytes()


def _json(read: Callable[[Path], Any], *objects: Any) -> FileTarget:
    return FileTarget(read, [json.dumps(x).encode() for x in objects], "a.json", structured=True)


def recording() -> FileTarget:
    """Recordings in Parquet, whose pages have checksums."""
    from wrenchbed.data.recording import Recording

    read = lambda path: dict(Recording.read(path).columns)  # noqa: E731
    return FileTarget(read, [_parquet(columns(30))], "rec.parquet")


def recording_metadata() -> FileTarget:
    from wrenchbed.data.recording import Recording

    def read(path: Path) -> None:
        table = parquet.table_of(columns(30), {})
        beside = path.with_name("rec.parquet")
        parquet.write(beside, table.replace_schema_metadata({parquet.KEY: path.read_bytes()}))
        json.dumps(Recording.read(beside).metadata.to_json())

    return _json(read, METADATA.to_json())


def plan() -> FileTarget:
    from wrenchbed.data.plan import Plan, is_plan

    poses = {k: v for k, v in columns(30).items() if k[0] == "q" or k == "segment"}
    touches = poses | {c: np.full(30, 0.5) for c in ("px", "py", "pz")}
    seeds = [_parquet(p) for p in (poses, touches)]
    return FileTarget(lambda p: (is_plan(p), Plan.read(p)) is None, seeds, "plan.parquet")


def journal() -> FileTarget:
    """The journal of a recording that was not finished."""
    from wrenchbed.data.recording import Recording

    table, stream = parquet.table_of(columns(30), METADATA.to_json()), io.BytesIO()
    with pa.ipc.new_stream(stream, table.schema) as writer:
        for batch in table.to_batches(max_chunksize=10):
            writer.write_batch(batch)
    read = lambda path: Recording.read(path.with_name("rec.parquet")) is None  # noqa: E731
    return FileTarget(read, [stream.getvalue()], "rec.parquet.journal")


def points() -> FileTarget:
    from wrenchbed.data.plan import read

    seed = "x,y,z\n" + "\n".join(f"0.{k},0.2,-0.{k}" for k in range(9))
    return FileTarget(lambda path: None if read(path).shape[1] == 3 else 1 / 0, [seed.encode()],
                      "points.csv")  # fmt: skip


def twin_json() -> FileTarget:
    """Twins, which `simulate` and `export` read."""
    from wrenchbed.twin.twin import Twin

    effects = [{"effect": "joint.compliance", "parameters": {"joint": 2, "stiffness": 9000.0}}]
    plain = {"format": 1, "robot": "ur5", "gravity": [0.0, 0.0, -9.8], "recording": "rec.parquet",
             "theta": {"tool.mass": 1.3}}  # fmt: skip
    twins = [Twin.from_json(plain | {"effects": some}).to_json() for some in (effects, [])]
    return _json(lambda p: Twin.read(p) is None, *twins)


def fit_json() -> FileTarget:
    """Fits, which `view` and `report` hold against a recording."""
    from wrenchbed import registry
    from wrenchbed.simulation.closed_form import Model
    from wrenchbed.twin.simulator_predictions import _read

    robot = registry.load("robots", "ur5")
    model = Model(robot, tuple(robot.gravity))
    theta = {p.name: p.nominal for p in robot.parameters}
    raw = {"format": 1, "robot": "ur5", "theta": theta, "parameters": [], "recording": "rec"}
    return _json(lambda p: _read(p, model) and None, raw)


def sealed_json() -> FileTarget:
    """Answers, claims and commitments of the sealed benchmark, which others write."""
    from wrenchbed.benchmark.sealed import commitments, score

    def read(path: Path) -> None:
        for name in (score.CLAIM, score.RUN, commitments.COMMITMENTS):
            (path.parent / name).write_bytes(path.read_bytes())
        score.read(path.parent)
        (path.parent / score.RUN).unlink()
        score.read(path.parent)
        for reader, at in ((commitments.read_answer, path), (commitments.read, path.parent)):
            with contextlib.suppress(WrenchbedError):
                reader(at)

    claim = {"verdict": "identified", "causes": [{"effect": "joint.compliance", "probability": 0.9,
             "parameters": {"stiffness": [9000.0, 100.0]}}], "closed": 0.9}  # fmt: skip
    run = {"seconds": 3.0, "error": "", "recording": "0" * 64}
    sealed = {"format": 1, "cases": {"case-1": {"recording": "0" * 64, "answer": "1" * 64}}}
    oracle = {"verdict": "none", "causes": [["a", 1]], "closed": 0.5}
    true = {"format": 1, "case": "c", "robot": "ur5", "mode": "static", "kind": "x", "causes": [],
            "minor": [], "rows": 3, "oracle": oracle, "salt": "s"}  # fmt: skip
    return _json(read, claim, run, sealed, true)


def map_toml() -> FileTarget:
    import wrenchbed as wb
    from wrenchbed.data.column_map import ready

    seeds = [path.read_bytes() for path in ready().values()]
    return FileTarget(lambda p: wb.read_map(p) is None, seeds, "map.toml")


def robot_toml() -> FileTarget:
    """A user's robot as TOML, beside its URDF."""
    from wrenchbed.robots.described import describe, read

    urdf = b"""<robot name="two"><link name="base"/><link name="a"><inertial><mass value="1"/>
<origin xyz="0 0 .1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="j1" type="revolute"><parent link="base"/><child link="a"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="9"/></joint></robot>"""
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder, "a.urdf"), Path(folder, "my.toml")
        file.write_bytes(urdf)
        text = describe(file, "a", out, tool_mass=1.0, tool_cog=(0, 0, 0.1)).text
    return FileTarget(lambda p: read(p) is None, [text.encode()], "my.toml",
                      beside=[{"a.urdf": urdf}])  # fmt: skip


def robot_model() -> FileTarget:
    """A user's robot as MJCF and as URDF, without its meshes."""
    from wrenchbed.robots.model_file import read_arm

    robots = Path(__file__).parents[1] / "data" / "robots"
    seeds = [(robots / name).read_bytes() for name in ("ur5e.xml", "ur10.urdf")]
    return FileTarget(lambda p: read_arm(p, "wrist_3_link") is None, seeds, "arm.xml")


LOGS: dict[str, Callable[[], FileTarget]] = {
    "mcap": mcap, "mcap-no-crc": mcap_without_checksums, "bag1": bag1,
    "bag2": lambda: _of_bag2("log.db3"), "bag2-metadata": lambda: _of_bag2("metadata.yaml"),
    "csv": csv_table,
}  # fmt: skip
SETTINGS: dict[str, Callable[[], FileTarget]] = {
    "recording": recording, "recording-metadata": recording_metadata, "plan": plan,
    "journal": journal, "points": points, "twin": twin_json, "fit": fit_json,
    "sealed": sealed_json, "map": map_toml, "robot-toml": robot_toml,
    "robot-model": robot_model,
}  # fmt: skip
