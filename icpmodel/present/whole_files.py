"""Atomic writing of files: at any moment, and after any failure, either the old file is there or the new one.

A file is replaced only if it is recognised as one of icpmodel's or is empty; a symbolic link never is.
"""

from __future__ import annotations

import os
import platform
import re
import secrets
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from ..errors import FileError, IcpError, InputError
from ..numerics.arrays import described


def as_path(value: Any, name: str = "path") -> Path:
    """`value`, the argument `name`, as a Path. Raises InputError if it is no path, FileError if it is empty."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"{name} is {described(value)}; a text or a pathlib.Path was expected")
    if not str(value):
        raise FileError(f"the {name} is empty; the name of a file was expected")
    return Path(value)


@contextmanager
def file_errors(path: Path, done: str) -> Iterator[None]:
    """Turn any error of the system or a library in a block, in which `path` is `done`, into a FileError naming it."""
    try:
        yield
    except IcpError:
        raise
    except Exception as error:  # libraries raise errors of any class on damaged files, and say little
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        if isinstance(error, FileNotFoundError) and done == "read":
            raise FileError(f"{path}: no such file or folder") from error
        raise FileError(f"{path}: cannot be {done} ({reason})") from error


def write_whole(path: Path, write: Callable[[BinaryIO], Any], check: Callable[[], None]) -> None:
    """Call `check`, which may raise, then write the file `path` atomically by `write`. Raises FileError."""
    with file_errors(path, "written"):
        check()
        with part_of(path) as file:
            write(file)
            put_in_place(file, path)


def write_ours(path: Path, content: bytes, *, begins: bytes = b"", holds: bytes = b"") -> None:
    """Write `content` to the file `path` atomically, if that passes `check_ours`. Raises FileError."""
    write_whole(path, lambda file: file.write(content), lambda: check_ours(path, begins=begins, holds=holds))


def place_of(path: Any, written: tuple[str, ...], *, begins: bytes = b"", holds: bytes = b"") -> Path:
    """`path` as a Path, if its suffix is one of `written` and it passes `check_ours`. Raises InputError, FileError."""
    place = as_path(path)
    check_suffix(place, written)
    check_ours(place, begins=begins, holds=holds)
    return place


def check_ours(path: Path, *, begins: bytes = b"", holds: bytes = b"") -> None:
    """Raise FileError if the file at `path` does not begin with `begins`, lacks `holds`, or cannot be replaced."""

    def recognise() -> None:
        with file_errors(path, "read"):
            content = path.read_bytes()
        if not content.startswith(begins) or holds not in content:
            raise FileError("it was not written by icpmodel")

    check_replaceable(path, recognise)


def check_replaceable(path: Path, recognise: Callable[[], None]) -> None:
    """Raise FileError if no file can be written at `path`, or `recognise` raises it for the nonempty file there.

    None can be written if the folder is missing or protected, nor in place of a link, a folder or a protected file.
    """
    if not path.parent.is_dir():
        raise FileError(f"{path}: the folder {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise FileError(f"{path}: cannot be written, as the folder {path.parent} is protected")
    if path.is_symlink():
        raise FileError(f"{path}: is a symbolic link, which is not followed; name the file behind it, or another one")
    if not os.path.lexists(path) or (path.is_file() and not path.stat().st_size):
        return
    try:
        if not path.is_file():
            raise FileError(f"it is {'a folder' if path.is_dir() else 'no file'}")
        recognise()
        path.open("r+b").close()  # it is protected where this fails
    except FileError as error:
        raise FileError(f"{path}: is in the way; remove it, or choose another name ({error})") from error


def check_suffix(path: Path, written: tuple[str, ...]) -> None:
    """Raise FileError unless the suffix of `path` is one of those `written`."""
    if path.suffix.lower() not in written:
        ends = in_words(written)
        raise FileError(f"{path}: a file name that ends in {ends} was expected; all of it is written to one file")


def in_words(suffixes: Sequence[str]) -> str:
    """The suffixes in a list, with "or" before the last one."""
    *others, last = suffixes
    return " or ".join(filter(None, (", ".join(others), last)))


@contextmanager
def part_of(path: Path) -> Iterator[BinaryIO]:
    """Open a new file in the folder of `path`, with the access rights of a file at `path`; remove it at the end.

    Its name contains the name of the machine and the number of the process. So the files of killed
    processes are recognised; those in the folder are removed first.
    """
    _remove_left_parts(path.parent)
    file = path.with_name(f".{_machine()}-{os.getpid()}-{secrets.token_hex(4)}.part").open("x+b")
    try:
        with file:
            if path.exists():
                shutil.copymode(path, file.name)
            yield file
    finally:
        Path(file.name).unlink(missing_ok=True)


def put_in_place(file: BinaryIO, path: Path) -> None:
    """Rename the `file` that `part_of` has opened to `path`, once all of it is on the disk."""
    file.flush()
    os.fsync(file.fileno())
    Path(file.name).replace(path)
    # the new name reaches the disk with its folder, if the file system can write that
    with suppress(OSError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _machine() -> str:
    return re.sub(r"\W", "", platform.node())


def _remove_left_parts(folder: Path) -> None:
    part = re.compile(rf"\.{_machine()}-(\d+)-[0-9a-f]{{8}}\.part")
    names: list[str] = []
    with suppress(OSError):  # the user may have no right to list the folder
        names = os.listdir(folder)
    for name in names:
        if (match := part.fullmatch(name)) and not _lives(int(match[1])):
            with suppress(OSError):  # in a shared folder it may be another user's
                (folder / name).unlink(missing_ok=True)


def _lives(process: int) -> bool:
    """Whether a process of this number may be running."""
    if sys.platform == "win32":  # where signal 0 is CTRL_C_EVENT, which would be sent
        return True
    try:
        os.kill(process, 0)
    except OSError as error:
        return not isinstance(error, ProcessLookupError)
    return True
