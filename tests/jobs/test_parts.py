"""Finished parts of long work are kept, whatever stopped it."""

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchbed.errors import BenchmarkError
from wrenchbed.jobs import parts


def squares(shared: int, number: int) -> list[parts.Row]:
    return [{"number": number, "square": number**2 + shared}]


@pytest.mark.slow
def test_finished_parts_are_not_done_again(tmp_path):
    counts: list[int] = []
    store = parts.Parts(tmp_path, "x-")
    table = parts.run(squares, 1, range(4), store, counts.append, processes=2)
    assert table["square"].to_pylist() == [1, 2, 5, 10]
    assert sum(counts) == 4
    store.path(2).unlink()
    (tmp_path / f".{store.path(1).name}.0.part").write_bytes(b"half")
    store.path(3).write_bytes(b"PAR1 cut short")
    marked = pa.table({"number": [0], "square": [99]})
    pq.write_table(marked, store.path(0))
    again = parts.run(squares, 1, range(4), store, processes=2)
    assert again["square"].to_pylist() == [99, 2, 5, 10]


def broken(shared: int, number: int) -> list[parts.Row]:
    raise ValueError(f"part {number}")


def test_a_part_that_fails_says_so(tmp_path):
    with pytest.raises(ValueError, match="part"):
        parts.run(broken, 0, range(2), parts.Parts(tmp_path, "b-"), processes=1)
    assert not list(tmp_path.iterdir())


def test_keys_change_with_their_content():
    assert parts.key(1, [2]) == parts.key(1, [2])
    assert parts.key(1, [2]) != parts.key(1, [3])


def test_parts_are_tables_in_the_order_of_their_numbers(tmp_path):
    schema = pa.schema([("robot", pa.int64())])
    store = parts.Parts(tmp_path, schema=schema)
    assert store.table().num_rows == 0 and store.table().schema == schema
    store.write(2, [{"robot": 5}])
    store.write(1, [{"robot": 7}, {"robot": 6}])
    (tmp_path / "notes.parquet").write_text("mine")
    assert store.numbers() == [1, 2]
    assert store.table()["robot"].to_pylist() == [7, 6, 5]
    store.remove()
    assert [p.name for p in tmp_path.iterdir()] == ["notes.parquet"]


def test_folders_of_another_run_are_refused(tmp_path):
    settings, folders = tmp_path / "a" / "run.json", (tmp_path / "a", tmp_path / "b")
    parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)
    assert all(folder.is_dir() for folder in folders)
    (tmp_path / "b" / "thesis.tex").write_text("mine")
    with pytest.raises(BenchmarkError, match=r"b: holds other files, such as thesis\.tex"):
        parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)
    settings.write_text(json.dumps({"seed": 1, "commitments": None}))
    parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)
    with pytest.raises(BenchmarkError, match="seed = 1, not 2"):
        parts.check_folders(settings, {"seed": 2}, folders, BenchmarkError)
    settings.write_text("[]")
    with pytest.raises(BenchmarkError, match="is broken"):
        parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)
