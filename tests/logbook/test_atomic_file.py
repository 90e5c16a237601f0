"""The one writer of files: complete or absent after a kill, no planted link followed, nothing replaced unasked."""

import ast
import errno
import os
import re
import signal
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import pytest
from helpers.paths import ROOT

from filters.errors import InputError
from imutui.logbook import SessionInfo, atomic_file, file_lock
from imutui.logbook.writer import LogWriter, whole_log

OLD, NEW = "old\n" * 100, "new\n" * 100
START = 1_795_257_000_000_000_000


def by_path(path: Path, *, overwrite: bool) -> None:
    with atomic_file.part_of(path, overwrite=overwrite) as part:
        part.write_text(NEW)


def growing(path: Path, *, overwrite: bool) -> None:
    with open(atomic_file.create(path, overwrite=overwrite), "w") as stream:
        stream.write(NEW)


def at_once(path: Path, *, overwrite: bool) -> None:
    atomic_file.write(path, NEW, overwrite=overwrite)


WHOLE = (at_once, by_path)
WRITERS = (*WHOLE, growing)


def in_child(do: Callable[[], object]) -> int:
    """Exit status of a process that does something; 17 if it raises OSError, 18 if InputError."""
    pid = os.fork()
    if not pid:
        code = 1
        try:
            do()
            code = 0
        except OSError:
            code = 17
        except InputError:
            code = 18
        finally:
            os._exit(code)
    return os.waitpid(pid, 0)[1]


def killed_at(moment: int) -> Callable[[str, tuple[object, ...]], None]:
    """A hook that kills this process before its so many'th call that touches files."""
    count = 0

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal count
        if event == "open" or event.startswith("os."):
            count += 1
            if count == moment:
                os.kill(os.getpid(), signal.SIGKILL)

    return hook


def killed_writing(write: Callable[..., None], path: Path, overwrite: bool, moment: int) -> None:
    sys.addaudithook(killed_at(moment))
    write(path, overwrite=overwrite)


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("write", WHOLE)
def test_a_kill_at_any_moment_leaves_the_file_complete_or_as_it_was(
    write: Callable[..., None], overwrite: bool, tmp_path: Path
) -> None:
    found, moment = [], 0
    while True:
        moment += 1
        folder = tmp_path / str(moment)
        folder.mkdir()
        path = folder / "a.toml"
        if overwrite:
            path.write_text(OLD)
        status = in_child(partial(killed_writing, write, path, overwrite, moment))
        found.append(path.read_text() if path.exists() else None)
        assert {name.suffix for name in folder.iterdir()} <= {".toml", ".part"}
        if status == 0:
            break
        assert os.WTERMSIG(status) == signal.SIGKILL
    assert moment > 4
    assert set(found) == {OLD if overwrite else None, NEW}
    assert [name.name for name in folder.iterdir()] == ["a.toml"]


@pytest.mark.parametrize("write", WRITERS)
def test_no_planted_link_is_followed(write: Callable[..., None], tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    victim.chmod(0o600)
    folder = tmp_path / "shared"
    folder.mkdir()
    (folder / "a.toml.part").symlink_to(victim)
    write(folder / "a.toml", overwrite=False)
    (folder / "b.toml").symlink_to(victim)
    with pytest.raises(FileExistsError):
        write(folder / "b.toml", overwrite=False)
    (folder / "dangling.toml").symlink_to(tmp_path / "to be made")
    with pytest.raises(FileExistsError):
        write(folder / "dangling.toml", overwrite=False)
    write(folder / "b.toml", overwrite=True)
    assert not (folder / "b.toml").is_symlink()
    assert (folder / "a.toml").read_text() == (folder / "b.toml").read_text() == NEW
    assert not (tmp_path / "to be made").exists()
    assert (victim.read_text(), stat.S_IMODE(victim.stat().st_mode)) == ("mine", 0o600)


@pytest.mark.parametrize("write", WRITERS)
def test_a_name_that_is_taken_meanwhile_keeps_its_file(write: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(OLD)
    with pytest.raises(FileExistsError) as raised:
        write(path, overwrite=False)
    assert raised.value.filename == str(path)
    late = tmp_path / "late.toml"
    with pytest.raises(FileExistsError), atomic_file.part_of(late, overwrite=False) as part:
        part.write_text(NEW)
        late.write_text(OLD)
    assert path.read_text() == late.read_text() == OLD
    assert sorted(name.name for name in tmp_path.iterdir()) == ["a.toml", "late.toml"]


def _written(path: Path, n: int, overwrite: bool) -> int:
    try:
        atomic_file.write(path, f"{n}\n" * 10_000, overwrite=overwrite)
    except FileExistsError:
        return 0
    return 1


@pytest.mark.parametrize("overwrite", [False, True])
def test_of_several_writers_at_once_each_writes_a_file_of_its_own(overwrite: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    with get_context("fork").Pool(4) as pool:
        count = sum(pool.starmap(_written, [(path, n, overwrite) for n in range(40)]))
    assert count == (40 if overwrite else 1)
    lines = path.read_text().split()
    assert (len(lines), len(set(lines))) == (10_000, 1)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("both", [False, True])
def test_file_systems_without_hard_links_replace_nothing(
    both: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`both`: neither links nor a rename that refuses."""

    def refused(*_: object, **__: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "link", refused)
    if both:
        import ctypes

        monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: object())
    for write in WRITERS:
        path = tmp_path / write.__name__
        write(path, overwrite=False)
        with pytest.raises(FileExistsError):
            write(path, overwrite=False)
        late = tmp_path / f"{write.__name__} late"
        with pytest.raises(FileExistsError), atomic_file.part_of(late, overwrite=False) as part:
            part.write_text(NEW)
            late.write_text(OLD)
        assert (path.read_text(), late.read_text()) == (NEW, OLD)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("write", WRITERS)
def test_a_folder_that_cannot_be_written_is_named_and_left_alone(write: Callable[..., None], tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as raised:
        write(tmp_path / "none" / "a.toml", overwrite=False)
    assert raised.value.filename == str(tmp_path / "none" / "a.toml")
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o555)

    def as_other_user() -> None:
        if os.geteuid() == 0:  # root may write everywhere
            os.setuid(65534)
        write(locked / "a.toml", overwrite=True)

    assert os.waitstatus_to_exitcode(in_child(as_other_user)) == 17
    assert list(locked.iterdir()) == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder that takes 64 kB: a small file system, or where none may be mounted a limit on files' sizes."""
    import resource

    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(folder)]
    if os.geteuid() == 0 and subprocess.run(mount, capture_output=True, check=False).returncode == 0:
        yield folder
        subprocess.run(["umount", str(folder)], check=True)
        return
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (65536, before[1]))
    yield folder
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


def test_a_full_disk_leaves_what_was_there(small_disk: Path) -> None:
    path = small_disk / "a.toml"
    path.write_text(OLD)
    for name, overwrite in (("a.toml", True), ("b.toml", False)):
        with pytest.raises(OSError, match=r"No space|too large") as raised:
            atomic_file.write(small_disk / name, "x" * 100_000, overwrite=overwrite)
        assert raised.value.errno in (errno.ENOSPC, errno.EFBIG)
        assert raised.value.filename == str(small_disk / name)
    with (
        pytest.raises(OSError, match=r"No space|too large"),
        whole_log(small_disk / "c.mcap", SessionInfo(), "x" * 100_000, overwrite=False, mode=0o600),
    ):
        pass
    assert list(small_disk.iterdir()) == [path]
    assert path.read_text() == OLD


def test_permissions_are_those_of_the_umask_unless_given(tmp_path: Path) -> None:
    for umask in (0o022, 0o077):
        before = os.umask(umask)
        try:
            for write in WRITERS:
                write(tmp_path / "a", overwrite=True)
                assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o666 & ~umask
            atomic_file.write(tmp_path / "b", NEW, overwrite=True, mode=0o644)
            assert stat.S_IMODE((tmp_path / "b").stat().st_mode) == 0o644
        finally:
            os.umask(before)


def test_the_longest_names_can_be_written(tmp_path: Path) -> None:
    for name in ("x" * 255, "é" * 127):
        for write in WRITERS:
            write(tmp_path / name, overwrite=True)
            assert (tmp_path / name).read_text() == NEW


@pytest.mark.parametrize(
    "write", [*WRITERS, lambda path, overwrite: LogWriter(path, SessionInfo(), "", 0, overwrite=overwrite)]
)
def test_a_running_recording_is_not_replaced_even_by_force(write: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recording = LogWriter(path, SessionInfo(), "", START)
    size, file = path.stat().st_size, path.stat().st_ino
    with pytest.raises(InputError, match="is being written"):
        write(path, overwrite=True)
    assert (path.stat().st_size, path.stat().st_ino) == (size, file)
    late = tmp_path / "late.mcap"
    with pytest.raises(InputError, match="is being written"), atomic_file.part_of(late, overwrite=True):
        running = LogWriter(late, SessionInfo(), "", START)
    for log in (recording, running):
        log.finish({}, START)
    assert sorted(name.suffix for name in tmp_path.iterdir()) == [".mcap", ".mcap", ".sha256", ".sha256"]
    write(path, overwrite=True)
    assert path.stat().st_ino != file


def test_the_system_knows_a_growing_file_by_its_name(tmp_path: Path) -> None:
    """What is renamed meanwhile is followed by it."""
    for overwrite in (False, True):
        path = tmp_path / "a.mcap"
        log = LogWriter(path, SessionInfo(), "", START, overwrite=overwrite)
        assert Path(f"/proc/self/fd/{log._file.fileno()}").readlink() == path
        assert file_lock.is_held(path.open("rb"))
        log.finish({}, START)


ELSEWHERE = {
    "imutui/logbook/atomic_file.py": "the writer itself",
    "imutui/defects.py": "mkstemp in the temporary folder, where nothing of imutui may be needed any more",
    "imutui/session/processes.py": "appends to the stderr of a process, in the private runtime folder",
    "imutui/session/ipc.py": "locks in the private runtime folder",
    "imutui/jobs/campaign/results_folder.py": "the journal, which only grows, and its lock; no link is followed",
    "imutui/instrument/pseudo_terminal.py": "a link to a terminal",
    "imutui/logbook/reader.py": "replaces a field of a record",
    "imutui/logbook/recover.py": "fills the file that atomic_file made",
    "imutui/logbook/export/formats.py": "fills the file that atomic_file made",
    "imutui/logbook/bag.py": "unpacks into the file that atomic_file made",
    "imutui/cli/virtual.py": "streams into the files that atomic_file made",
}
CALLS = {"write_text", "write_bytes", "savez", "savez_compressed", "touch", "link", "symlink_to", "hardlink_to"}
RECORDS = re.compile(r"atomic_file\.|log_files\.rename|(line|left|row|.*self\.line\(.*\))\.truncate")
CALLS |= {"rename", "renames", "truncate", "mkstemp", "NamedTemporaryFile", "copyfile", "copy2", "move"}


def writes(call: ast.Call) -> bool:
    """Whether a call may make or replace a file by its name."""
    function = call.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    words = [ast.unparse(word) for word in [*call.args, *(key.value for key in call.keywords)]]
    owner = ast.unparse(function.value) if isinstance(function, ast.Attribute) else ""
    if name == "open":
        modes = [word.strip("'\"") for word in words if word[:1] in "'\""]
        return any("O_CREAT" in word for word in words) or any(
            set(mode) & set("wax+") and len(mode) < 5 for mode in modes
        )
    if name == "replace":  # of a path, not of a text or a record
        return owner == "os" or (len(call.args) == 1 and not call.keywords)
    return name in CALLS and not RECORDS.match(ast.unparse(function))


def test_nothing_else_writes_files() -> None:
    """What writes files elsewhere says here why it may."""
    found = set()
    for path in sorted((ROOT / "imutui").rglob("*.py")):
        module = path.relative_to(ROOT).as_posix()
        calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
        found |= {module for call in calls if writes(call)}
    assert sorted(found ^ set(ELSEWHERE)) == []
