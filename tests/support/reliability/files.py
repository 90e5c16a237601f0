"""The disk is full, power goes, a file is there already, or is changed afterwards."""

import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from helpers import ros_messages
from helpers.acquisitions import acquiring, mounted
from helpers.commands import imutui
from helpers.fake_devices import Device, Habits, answers
from helpers.logs import recorded
from helpers.processes import wait_until
from helpers.readers import by_mcap

from imutui.jobs.check import check
from imutui.jobs.recover import recover
from imutui.logbook import SessionInfo, reader, schemas, summary
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.writer import LogWriter
from imutui.session.metadata import default_path

_START = 1_795_257_000_000_000_000
_NAME = re.compile(r"imu400cd_9911750_\d{8}T\d{6}Z_cold-start(_\d+)?\.mcap")


@dataclass(frozen=True)
class Synced:
    """What was asked of the disk while a log was written."""

    # flushes, data: flushes that were asked for, and calls of fdatasync on the file
    flushes: int
    data: int
    folder: int  # calls of fsync on its folder: its name is on the disk too


def synced(folder: Path, flushes: int) -> Synced:
    """Write a log with so many flushes, and count what is synchronised."""
    data: list[int] = []
    folders: list[int] = []
    fsync, fdatasync = os.fsync, os.fdatasync

    def counted(descriptor: int) -> None:
        if os.path.samestat(os.fstat(descriptor), folder.stat()):
            folders.append(descriptor)
        fsync(descriptor)

    def data_counted(descriptor: int) -> None:
        data.append(descriptor)
        fdatasync(descriptor)

    with patch.object(os, "fsync", counted), patch.object(os, "fdatasync", data_counted):
        log = LogWriter(folder / "synced.mcap", SessionInfo(), "", _START)
        begun = len(data)
        for _ in range(flushes):
            log.flush()
        asked = len(data) - begun
        log.finish({}, _START)
    return Synced(flushes, asked, len(folders))


@dataclass(frozen=True)
class Cuts:
    """What a reader made of a log that was cut."""

    # count, wrong: how many cuts, and how many of them were read as something else than a true beginning that says so
    count: int
    wrong: int
    samples: set[int]  # how many samples were read


def cuts(folder: Path, every: int) -> Cuts:
    """Cut a small log at each so many bytes, and about each record's ends, as when power went."""
    whole = recorded(folder / "whole.mcap", seconds=2, rate=3)
    data, gyro = whole.read_bytes(), reader.read(whole).samples.gyro
    cut, wrong, samples = folder / "cut.mcap", 0, set()
    places = sorted({*range(0, len(data), every), *range(len(data) - 12, len(data)), *_edges(data)})
    for size in places:
        cut.write_bytes(data[:size])
        try:
            log = reader.read(cut)
        except UnreadableLogError as error:
            wrong += str(cut) not in str(error)
            samples.add(0)
            continue
        honest = log.damage or not log.finished
        wrong += not (honest and np.array_equal(log.samples.gyro, gyro[: len(log.samples.gyro)], equal_nan=True))
        samples.add(len(log.samples.gyro))
    return Cuts(len(places), wrong, samples)


def _edges(data: bytes) -> Iterator[int]:
    at = 8
    while at + 9 < len(data) - 8:
        yield from (at - 1, at, at + 1, at + 5, at + 9)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")


@dataclass(frozen=True)
class DiskFull:
    """What is left when a disk took no more: packets by the stream, by the index once recovered; and the exit code."""

    exit_code: int
    words: str
    streamed: int
    recovered: int


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A disk of 200 KiB with 32 left."""
    with mounted(folder / "disk", "200k") as place:
        (place / "filler").write_bytes(bytes(168 * 1024))
        yield place


def disk_full(folder: Path, disk: Path) -> DiskFull:
    """Record to a disk until it takes no more."""
    path, whole = disk / "out.mcap", folder / "recovered.mcap"
    keep_nothing_free = patch.dict(os.environ, {"IMUTUI_PATHS_MIN_FREE_MB": "0"})
    with keep_nothing_free, Device(Habits(answers(), streams=None)) as device:
        line = ("--port", device.port, "--filter", "none", "--duration", "60", "--json", "-o", str(path))
        done = imutui("record", *line, check=None)
    log = reader.read(path, raw=True)
    assert not log.finished
    assert [raw.sequence for raw in ros_messages.packets(log)] == list(range(len(ros_messages.packets(log))))
    recover(path, whole)
    return DiskFull(done.returncode, done.stderr, len(ros_messages.packets(log)), by_mcap(whole)[schemas.RAW])


@dataclass(frozen=True)
class Guarded:
    """How a recording ended before its disk was full."""

    stopped_s: float  # from the moment that others had filled the disk beyond the limit
    free_mb: float  # left then, of 2 MB that were to be left
    exit_code: int  # of the acquisition
    # finished, refused: whether its file is whole, and whether another recording was refused
    finished: bool
    refused: bool


def guarded(folder: Path) -> Guarded:
    """Fill the disk under a recording; needs a user who may mount, and skips the test that calls it else."""
    with mounted(folder / "disk", "4m") as disk:
        fields: dict[str, Any] = {"logs": str(disk / "logs"), "min_free_mb": 2.0}
        with acquiring(folder, **fields, output=str(disk / "logs" / "a.mcap")) as run:
            (disk / "others").write_bytes(bytes(2_500_000))
            since = time.monotonic()
            wait_until(run.engine.lifecycle.ended.is_set)
            stopped_s = time.monotonic() - since
            assert run.engine.result is not None
            finished = reader.read(Path(run.engine.result["log"])).finished
        free_mb, refused = shutil.disk_usage(disk).free / 1e6, False
        try:
            with acquiring(folder, **fields, output=str(disk / "logs" / "b.mcap")):
                pass
        except OSError:
            refused = True
    return Guarded(stopped_s, free_mb, run.engine.exit_code, finished, refused)


@dataclass(frozen=True)
class Overwriting:
    """What became of a file that was there already, and how names are made."""

    # refused, unchanged: whether the second writer was refused, and the file is as it was
    refused: bool
    unchanged: bool
    names: list[str]  # made up one after the other within one second
    unfinished_told: bool  # whether a file without a footer is told as unfinished, whatever its name

    @property
    def names_are_right(self) -> bool:
        """Whether all differ, and have unit, UTC and note in them."""
        return len(set(self.names)) == len(self.names) and all(_NAME.fullmatch(name) for name in self.names)


def overwritten(folder: Path) -> Overwriting:
    """Write a log where one is, and make up names for two in one second."""
    path = recorded(folder / "a.mcap", seconds=1)
    before, refused = path.read_bytes(), False
    try:
        LogWriter(path, SessionInfo(), "", _START)
    except FileExistsError:
        refused = True
    names = []
    for _ in range(2):
        made = default_path(folder, "imu400cd", "9911750", "Cold start")
        writer = LogWriter(made, SessionInfo(), "", _START)
        names.append(made.name)
    told = summary.read(made).state != "finished"
    del writer
    return Overwriting(refused, path.read_bytes() == before, names, told)


def flipped(folder: Path, count: int, seed: int = 0) -> int:
    """Flip a bit of a finished log in so many places, each alone; returns how many `check` did not find."""
    path = recorded(folder / "flip.mcap", seconds=1)
    data, rng = path.read_bytes(), np.random.default_rng(seed)
    assert not _differs(path)
    missed = 0
    for at in rng.choice(len(data), count, replace=False).tolist():
        path.write_bytes(data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :])
        missed += not _differs(path)
    return missed


def _differs(path: Path) -> bool:
    try:
        return any(finding["code"] == "sha256" for finding in check(path)["findings"])
    except UnreadableLogError:
        return True
