"""Atomic writing: a file is complete under its name, or what was there before is.
Free: the inside of each file (speed); tests/project/test_files.py and test_write_faults.py speak.
Others rely on: atomicity, locks, names of kept files (NAME~, NAME~2: change docs/contracts.md with
them); of `checked.Fields` that an absent entry is None and that errors name file and field.
Never: open an output in place; read JSON or TOML of others but by `checked`, with its limits."""

import errno
import fcntl
import json
import os
import secrets
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

TEMPORARY = ".wrenchbed-*.part"
"""Pattern of the temporary files and folders that a killed writer leaves in a folder."""
_AT_ONCE = 1 << 20
"""Size of a file's write buffer [B]: most files are written by one system call."""
_HELD: set[Path] = set()
"""Outputs that this process has locked."""
_ABANDONED_S = 60.0
"""Age of a temporary file that no process holds, from which it is a killed writer's [s]: a writer
holds its own within milliseconds."""
_SWEPT: set[Path] = set()
"""Folders in which this process has looked for what killed writers left."""
_LOCK_NAME = 60
"""Characters of a name in the name of its lock: a file system takes 255 bytes."""


@contextmanager
def atomic_write(path: str | Path) -> Iterator[BinaryIO]:
    """Yield a temporary file to write to; it takes the place of ``path`` when the block ends.

    The temporary file lies in the same folder, which is made if it is missing, and has a name
    that nobody can guess. Its content is on the disk before it takes the place of ``path``; if
    the block raises, it is deleted and ``path`` stays as it was. The new file has the permissions
    of the file before it, or those of any new file. If ``path`` is a symbolic or hard link, this
    name alone is replaced: the file that it shared or pointed to stays as it is.

    Raises:
        OSError: names ``path``, also where a disk is full.
    """
    path = Path(path)
    temporary = path.parent / _temporary_name()
    made: list[Path] = []
    try:
        mode = _replaceable(path)
        made += _make(path.parent)
        _sweep(path.parent)
        with open_new(temporary) as file:
            _hold(file.fileno())
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync(path.parent, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        _unmake(made)
        if isinstance(error, OSError) and error.errno and error.filename in (None, str(temporary)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Yield a temporary folder; the files written to it appear in ``path`` when the block ends.

    A new folder gets its name in one step. In an existing one, other files stay. If the block
    raises, or a folder or device has the name of a file to move, ``path`` stays as it was.

    Raises:
        OSError: names the file in ``path``.
    """
    path = Path(path)
    made: list[Path] = []
    handle, there = -1, path.is_dir()
    temporary = (path if there else path.parent) / _temporary_name()
    try:
        made += _make(temporary.parent)
        _sweep(temporary.parent)
        temporary.mkdir()
        handle = os.open(temporary, os.O_DIRECTORY | os.O_CLOEXEC)
        _hold(handle)
        yield temporary
        if there:
            _move(temporary, path)
        else:
            temporary.rename(path)
            _sync(path.parent, path)
    except OSError as error:
        named = Path(os.fsdecode(error.filename)) if error.filename else temporary
        if error.errno is not None and named.is_relative_to(temporary):
            final = path / named.relative_to(temporary)
            raise OSError(error.errno, error.strerror, str(final)) from error
        raise
    finally:
        if handle >= 0:
            os.close(handle)
        shutil.rmtree(temporary, ignore_errors=True)
        _unmake(made)


@contextmanager
def locked(path: str | Path, folder: bool = False) -> Iterator[None]:
    """Lock an output for this process while the block runs; the lock ends with the process.

    A file is locked by ``.NAME.lock`` beside it; a folder, which is made if it is missing, by
    itself. This process may lock the same output twice. File systems without locks lock nothing.

    Raises:
        BlockingIOError: another process writes to ``path``.
        OSError: names ``path``.
    """
    path = Path(path).absolute()
    if path in _HELD:
        yield
        return
    made: list[Path] = []
    name = path if folder else path.with_name(f".{path.name[-_LOCK_NAME:]}.lock")
    try:
        made += _make(path if folder else path.parent)
        handle = _lock(name, folder)
    except OSError as error:
        _unmake(made)
        busy = isinstance(error, BlockingIOError)
        text = "another process is writing to it" if busy else error.strerror
        raise OSError(error.errno, text, str(path)) from error
    _HELD.add(path)
    try:
        yield
    finally:
        _HELD.discard(path)
        if not folder:
            with suppress(OSError):
                name.unlink()
        os.close(handle)
        _unmake(made)


def set_aside(path: Path, suffix: str = "~", beside: str = "") -> Path | None:
    """Rename a file out of the way, to the first free one of NAME~, NAME~2, … (``suffix`` is the
    ~); return its new path, None if there was no file. No other file is replaced.

    A companion file, named NAME + ``beside`` (such as ``.json``), is renamed with it.
    """
    there = [end for end in dict.fromkeys(("", beside)) if os.path.lexists(f"{path}{end}")]
    if not there:
        return None
    kept, number = Path(f"{path}{suffix}"), 1
    while any(os.path.lexists(f"{kept}{end}") for end in ("", beside)):
        number += 1
        kept = Path(f"{path}{suffix}{number}")
    for end in there:
        Path(f"{path}{end}").rename(f"{kept}{end}")
    return kept


def put_back(kept: Path, path: Path, beside: str) -> None:
    """Undo `set_aside`: rename ``kept`` and its companion file (+ ``beside``) back to ``path``."""
    for end in dict.fromkeys(("", beside)):
        if os.path.lexists(f"{kept}{end}"):
            Path(f"{kept}{end}").rename(f"{path}{end}")


def open_new(path: Path) -> BinaryIO:
    """Create a file that must not exist yet and open it for writing bytes, without atomicity."""
    return open(path, "xb", _AT_ONCE, opener=no_link)


def remove(path: Path) -> None:
    """Delete a file, or a folder with its content."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, atomically; names of files that are not UTF-8 are escaped."""
    write_bytes(path, text.encode(errors="backslashreplace"))


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write bytes to a file, atomically."""
    with atomic_write(path) as file:
        file.write(data)


def write_json(path: str | Path, content: Any) -> None:
    """Write a JSON file, atomically; a `ValueError` if a number is not finite."""
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def _temporary_name() -> str:
    return TEMPORARY.replace("*", secrets.token_hex(8))


def _hold(handle: int) -> None:
    """Lock an open temporary file or folder by its descriptor, if possible, to mark it as used."""
    with suppress(OSError):
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)


def _sweep(folder: Path) -> None:
    """Delete temporary files of killed writers in a folder; done once per process and folder."""
    if folder in _SWEPT:
        return
    _SWEPT.add(folder)
    for remainder in folder.glob(TEMPORARY):
        with suppress(OSError):  # held, or of a file system without locks
            handle = os.open(remainder, os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if time.time() - os.fstat(handle).st_mtime > _ABANDONED_S:
                    remove(remainder)
            finally:
                os.close(handle)


def no_link(name: str, flags: int) -> int:
    """Opener for `open` (file name, flags) that returns a file descriptor and does not follow
    symbolic links."""
    return os.open(name, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)


def _lock(name: Path, folder: bool) -> int:
    """Open and lock the lock file ``name``, or a folder itself; return its file descriptor."""
    kind = os.O_DIRECTORY if folder else os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW
    while True:
        handle = os.open(name, kind | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise
        except OSError:  # this file system has no locks
            return handle
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), name.stat(follow_symlinks=folder)):
                return handle
        os.close(handle)  # its last holder deleted it meanwhile


def _replaceable(path: Path) -> int | None:
    """Permissions of the file at ``path``, which may be replaced; None if there is none or a link.
    An `OSError` if a folder, a device or a write-protected file has the name."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, "is a folder; give the name of a file", str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is a device or a pipe; give the name of a file", str(path))
    if not status.st_mode & 0o222:
        raise PermissionError(errno.EACCES, "is write-protected; give another name", str(path))
    return None if path.is_symlink() else stat.S_IMODE(status.st_mode) & 0o777


def _make(folder: Path) -> list[Path]:
    """Make a folder and its missing parents; return those that were made, the outermost first."""
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    for made in reversed(missing):
        with suppress(FileExistsError):
            made.mkdir()
    return missing[::-1]


def _unmake(made: list[Path]) -> None:
    """Delete the folders in ``made`` that are still empty."""
    with suppress(OSError):
        for folder in reversed(made):
            folder.rmdir()


def _sync(folder: Path, named: Path) -> None:
    """Flush the directory entries of a folder to disk, where possible; errors name ``named``."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise OSError(error.errno, error.strerror, str(named)) from error
    finally:
        os.close(handle)


def _move(source: Path, folder: Path) -> None:
    """Move all files of a folder into another; if one cannot be moved, free names stay free."""
    pairs = [(p, folder / p.relative_to(source)) for p in sorted(source.rglob("*")) if p.is_file()]
    for file, place in pairs:
        if (mode := _replaceable(place)) is not None:
            file.chmod(mode)
    with ExitStack() as undo:
        for file, place in pairs:
            undo.callback(_unmake, _make(place.parent))
            if not os.path.lexists(place):
                undo.callback(place.unlink, missing_ok=True)
            file.replace(place)
        undo.pop_all()
    _sync(folder, folder)
