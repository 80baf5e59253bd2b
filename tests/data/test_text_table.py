"""Text files as programs and Excel write them, read without being told how."""

from pathlib import Path

import numpy as np
import pytest

from wrenchbed.data import text_table
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import MapError

HEADED = {
    "commas": b"t,fx,fy\n1.5,2.5,3\n4,5.5,6\n",
    "commas and blanks": b"t, fx, fy\n1.5, 2.5, 3\n4, 5.5, 6\n",
    "semicolons": b"t;fx;fy\r\n1.5;2.5;3\r\n4;5.5;6\r\n",
    "decimal commas": b"t;fx;fy\n1,5;2,5;3\n4;5,5;6\n",
    "tabs": b"t\tfx\tfy\n1.5\t2.5\t3\n4\t5.5\t6\n",
    "tabs and blanks": b"t fx \t fy\n1.5\t2.5   3\n 4  5.5\t6\n",
    "a comment": b"# t fx fy\n1.5 2.5 3\n4 5.5 6\n",
    "notes before": b"Sensor: Gamma, SI-65\nrate = 100 Hz\n\nt,fx,fy\n1.5,2.5,3\n4,5.5,6\n",
    "a separator at the end": b"t,fx,fy,\n1.5,2.5,3,\n4,5.5,6,\n",
    "quotes": b'"t","fx","fy"\n"1.5","2.5","3"\n"4","5.5","6"\n',
    "UTF-8 with mark": b"\xef\xbb\xbft,fx,fy\n1.5,2.5,3\n4,5.5,6\n",
    "UTF-16": "t;fx;fy\n1,5;2,5;3\n4;5,5;6\n".encode("utf-16"),
    "UTF-16 without mark": "t,fx,fy\n1.5,2.5,3\n4,5.5,6\n".encode("utf-16-le"),
    "UTF-16, large end first": "t,fx,fy\n1.5,2.5,3\n4,5.5,6\n".encode("utf-16-be"),
}


def table(folder: Path, content: bytes, **options):
    path = folder / "log.csv"
    path.write_bytes(content)
    return read_text(path, **options)


@pytest.mark.parametrize("content", HEADED.values(), ids=HEADED)
def test_a_table_is_found_however_it_is_written(tmp_path, content):
    found = table(tmp_path, content)
    read = {name: found.numbers(name).tolist() for name in found.table.column_names}
    assert read == {"t": [1.5, 4.0], "fx": [2.5, 5.5], "fy": [3.0, 6.0]}


def test_names_of_excel_are_windows_1252(tmp_path):
    found = table(tmp_path, "Zeit (µs);Größe\n1;2,5\n2;3\n".encode("cp1252"))
    assert found.table.column_names == ["Zeit (µs)", "Größe"]


def test_columns_without_a_header_are_numbered(tmp_path):
    found = table(tmp_path, b"1 2 3\n4 5 6\n")
    assert found.numbers("3").tolist() == [3.0, 6.0]


def test_columns_of_text_do_no_harm(tmp_path):
    found = table(tmp_path, b"time,fx,state\n0,1,ok\n1,2,held\n")
    assert found.numbers("fx").tolist() == [1.0, 2.0]
    with pytest.raises(MapError, match="column 'state', row 0: 'ok' is no number"):
        found.numbers("state")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"t,fx\n1,2\n2,x\n3,4\n", r"column 'fx', row 1: 'x' is no number \(line 3\)"),
        (b"t,fx\n1,2\n2,1e999\n3,4\n", r"column 'fx', row 1: .* not finite \(line 3\)"),
        (b"t,fx\nx,2\n2,3\n3,4\n4,5\n", r"column 't', row 0: 'x' is no number \(line 2\)"),
        (b"1,2\n2,nan\n", r"column '2', row 1: the value is missing or not finite \(line 2\)"),
        (b"t,fx\n1,2\n\n2,\n", r"column 'fx', row 1: .* missing or not finite \(line 4\)"),
        (b"t,fx,fy\n1,2,3\n1,2\n1,2,3\n", r"row 1 \(line 3\) has 2 cells, the rows before it 3"),
        (b"t,fx\n", "0 rows"),
        (b"", "0 rows"),
        (b"\x00\x01\x02" * 99, "is not text"),
    ],
    ids=str,
)
def test_a_cell_is_blamed_on_its_own_row(tmp_path, content, words):
    with pytest.raises(MapError, match=words):
        found = table(tmp_path, content)
        for name in found.table.column_names:
            found.numbers(name)


def test_a_separator_may_be_told(tmp_path):
    assert table(tmp_path, b"1:2\n3:4\n", separator=":").numbers("2").tolist() == [2.0, 4.0]


def test_whole_numbers_keep_their_digits(tmp_path):
    at = 1_708_857_503_929_545
    found = table(tmp_path, f"{at} 1.5\n{at + 1} 2.5\n".encode())
    assert np.diff(found.table.column("1").to_numpy()).tolist() == [1]


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_a_file_longer_than_what_its_layout_is_read_from(tmp_path, mark, monkeypatch):
    rows = np.random.default_rng(1).normal(size=(400, 3)).round(6)
    lines = [mark.join("abc"), *(mark.join(map(str, row)) for row in rows)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["# made by a test", *lines]) + "\n")
    monkeypatch.setattr(text_table, "_HEAD", 2000)
    found = read_text(path)
    assert found.skipped == 2
    assert np.array_equal(np.stack([found.numbers(c) for c in "abc"], axis=1), rows)
    with path.open("a") as stream:
        stream.write(mark.join(["1", "x", "2"]) + "\n")
    with pytest.raises(MapError, match=r"column 'b', row 400: 'x' is no number \(line 403\)"):
        read_text(path).numbers("b")
