"""The one writer of files: each file is complete under its name or absent, and no planted link is followed.

A file is written under a temporary name beside its own, `NAME.xxxxxxxx.part`, that is created with O_EXCL. It takes its
name in one step when it is complete and on the disk. Only a kill leaves a temporary file behind; an error removes it.
"""

import contextlib
import errno
import os
import secrets
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from imutui.logbook import file_lock

SUFFIX = ".part"
_MOST_BYTES = 200  # of a temporary name's beginning: file systems take names of 255 bytes
_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
_NO_DIRECTORY_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)  # of file systems without it: some network shares
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_AT_FDCWD, _RENAME_NOREPLACE = -100, 1


def write(path: Path, content: str | bytes, *, overwrite: bool, mode: int | None = None) -> None:
    """Write a file, complete and on the disk when this returns.

    Parameters
    ----------
    path
        File to write; a link of that name is replaced, not followed.
    content
        Text is written as UTF-8; bytes of file names that are no text stay as they are.
    overwrite
        Whether an existing file may be replaced.
    mode
        Permissions whatever the umask; None for those that the umask leaves.

    Raises
    ------
    FileExistsError
        If `path` exists and may not be replaced.
    InputError
        If a process records to `path`.
    """
    data = content.encode("utf-8", "surrogateescape") if isinstance(content, str) else content
    with (
        part_of(path, overwrite=overwrite, mode=mode) as part,
        open(os.open(part, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "wb") as stream,
    ):
        stream.write(data)


def write_all(folder: Path, contents: Mapping[str, bytes], *, overwrite: bool, own: Collection[str] = ()) -> list[Path]:
    """Write several files into a folder, which is made if absent; return their paths in order.

    `own`: names that may be replaced anyway, since the caller has written them.
    Raises FileExistsError if a file exists and may not be replaced; then none is written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in contents:
        if not overwrite and name not in own and os.path.lexists(folder / name):
            raise taken(folder / name)
    for name, content in contents.items():
        write(folder / name, content, overwrite=overwrite or name in own)
    return [folder / name for name in contents]


@contextlib.contextmanager
def part_of(path: Path, *, overwrite: bool, mode: int | None = None) -> Iterator[Path]:
    """Yield an empty file beside `path`; it takes that name when the block ends, and is removed if the block raises.

    Parameters and errors are those of `write`; an existing `path` is refused at the beginning and at the end.
    """
    if overwrite:
        file_lock.refuse_held(path)
    elif os.path.lexists(path):
        raise taken(path)
    part: Path | None = None
    try:
        descriptor, part = _temporary(path, mode)
        os.close(descriptor)
        yield part
        _sync(part)
        move(part, path, overwrite=overwrite)
    except OSError as error:
        # a user knows nothing of the temporary name, and a full disk comes without any
        if str(error.filename or "").endswith(SUFFIX) or (error.filename is None and error.errno in _FULL):
            error.filename = str(path)
        raise
    finally:
        if part is not None:
            part.unlink(missing_ok=True)
    sync_directory(path.parent)


def create(path: Path, *, overwrite: bool, mode: int | None = None) -> int:
    """Create an empty file that grows under its own name, claimed in `file_lock`; return its descriptor.

    Parameters and errors are those of `write`.
    """
    if not overwrite:
        try:
            descriptor = _new(path, mode)
        except FileExistsError as error:
            raise taken(path) from error
        file_lock.claim(descriptor)
        return descriptor
    descriptor, part = _temporary(path, mode)
    try:
        file_lock.claim(descriptor)
        move(part, path, overwrite=True)
    except BaseException:
        part.unlink(missing_ok=True)
        os.close(descriptor)
        raise
    return descriptor


def _temporary(path: Path, mode: int | None) -> tuple[int, Path]:
    """Create an empty file with a temporary name beside `path`; return its descriptor and its path."""
    beginning = os.fsdecode(os.fsencode(path.name)[:_MOST_BYTES])
    while True:
        part = path.with_name(f"{beginning}.{secrets.token_hex(4)}{SUFFIX}")
        try:
            return _new(part, mode), part
        except FileExistsError:
            continue
        except OSError as error:
            if error.filename == str(part):
                error.filename = str(path)
            raise


def _new(path: Path, mode: int | None) -> int:
    try:
        descriptor = os.open(path, _NEW, 0o666 if mode is None else mode)
    except NotADirectoryError as error:
        raise NotADirectoryError(errno.ENOTDIR, "is a file, not a folder", str(path.parent)) from error
    if mode is not None:
        os.fchmod(descriptor, mode)
    return descriptor


def move(path: Path, to: Path, *, overwrite: bool) -> None:
    """Rename a file within its folder in one step; raise FileExistsError if `to` exists and may not be replaced."""
    if overwrite:
        file_lock.refuse_held(to)
        path.replace(to)
        return
    try:
        os.link(path, to, follow_symlinks=False)
    except FileExistsError as error:
        raise taken(to) from error
    except OSError:  # a file system without hard links
        _rename_to_free_name(path, to)
        return
    path.unlink()


def _rename_to_free_name(path: Path, to: Path) -> None:
    import ctypes

    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    names = os.fsencode(path), os.fsencode(to)
    if rename is not None and not rename(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_NOREPLACE):
        return
    code = errno.ENOSYS if rename is None else ctypes.get_errno()
    if code == errno.EEXIST:
        raise taken(to)
    if code not in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP):
        raise OSError(code, os.strerror(code), str(to))
    # The file system has neither: an empty file of our own holds the name. Only a kill between these lines leaves it.
    os.close(os.open(to, _NEW))
    try:
        path.replace(to)
    except OSError:
        to.unlink()
        raise


def taken(path: Path) -> FileExistsError:
    """Return the error for a file that exists and is not to be replaced."""
    return FileExistsError(errno.EEXIST, "exists and is left as it is", str(path))


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_directory(folder: Path) -> None:
    """Write the names in a folder to the disk: those of files that were made, renamed or removed."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:  # a folder that may be written to and not listed
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_DIRECTORY_SYNC:
            raise
    finally:
        os.close(descriptor)
