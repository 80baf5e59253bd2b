"""Atomic writes: complete files or none, and errors that name the file."""

import errno
import stat

import pytest

from wrenchbed.files import TEMPORARY, atomic_write, write_bytes, write_json, write_text


def names_in(folder):
    return [p.name for p in folder.iterdir()]


def test_a_file_and_its_folder_appear(tmp_path):
    path = tmp_path / "new" / "a.json"
    write_json(path, {"ä": 1.0})
    assert path.read_text(encoding="utf-8") == '{\n "ä": 1.0\n}\n'
    assert names_in(path.parent) == ["a.json"]


def test_a_writer_that_fails_leaves_the_file_before_it(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "before")
    with pytest.raises(RuntimeError), atomic_write(path) as temporary:
        temporary.write_text("half of what comes aft")
        raise RuntimeError
    assert path.read_text() == "before"
    assert names_in(tmp_path) == ["a.txt"]


def test_a_full_disk_names_the_file_and_not_its_temporary_name(tmp_path):
    path = tmp_path / "a.txt"
    for named in (False, True):
        with pytest.raises(OSError) as error, atomic_write(path) as temporary:
            raise OSError(errno.ENOSPC, "No space left on device", *[str(temporary)] * named)
        assert (error.value.errno, error.value.filename) == (errno.ENOSPC, str(path))
    assert names_in(tmp_path) == []


def test_a_number_that_is_not_finite_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", [float("nan")])
    assert names_in(tmp_path) == []


def test_temporary_names_differ_and_lie_beside_the_file(tmp_path):
    path, names = tmp_path / "a.txt", set()
    for _ in range(3):
        with atomic_write(path) as temporary:
            assert temporary in tmp_path.glob(TEMPORARY)
            names.add(temporary.name)
    assert len(names) == 3


def test_a_written_file_has_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_bytes(tmp_path / "a", b"")
    modes = {stat.S_IMODE((tmp_path / n).stat().st_mode) for n in ("plain", "a")}
    assert len(modes) == 1


def test_a_folder_in_the_way_is_named(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(OSError) as error:
        write_text(tmp_path / "a", "text")
    assert str(tmp_path / "a") in str(error.value)
    assert not list(tmp_path.glob(TEMPORARY))
