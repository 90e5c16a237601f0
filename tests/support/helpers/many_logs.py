"""Logs for campaigns: many that are short, each with its own readings, and some that are none."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from helpers.logs import START
from imutui import declared
from imutui.jobs.campaign.one_log import Task, row_of
from imutui.jobs.campaign.rows import TIMINGS, ResultsDocument, Row
from imutui.logbook import SessionInfo, schemas
from imutui.logbook.writer import LogWriter

RATE = 20
GRAVITY = 9.78637


def still(path: Path, seed: int, seconds: int = 3) -> Path:
    """A finished log of a level unit at rest, whose readings are those of a seed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    info = SessionInfo(rate_hz=RATE, kind="simulated", serial_number=f"S{seed % 5}", operator="test")
    log = LogWriter(path, info, "", START, overwrite=True, checksum=False)
    gyro = rng.normal(scale=1e-3, size=(seconds * RATE, 3))
    accel = rng.normal(scale=1e-2, size=(seconds * RATE, 3)) - [0.0, 0.0, GRAVITY]
    for k in range(seconds * RATE):
        stamp = START + seed * 3_600_000_000_000 + k * 1_000_000_000 // RATE
        log.imu(stamp, stamp, gyro[k], accel[k])
        if k % RATE == 0:
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, 20.0 + seed % 7)[0], stamp, stamp)
    log.finish({}, START)
    return path


def foreign(path: Path) -> Path:
    """An MCAP file of another program, without anything that a filter could take."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="another program")
        schema = writer.register_schema("Pose", "jsonschema", b"{}")
        channel = writer.register_channel("/pose", "json", schema)
        writer.add_message(channel, START, b'{"x": 1}', START)
        writer.finish()
    return path


def two_hundred(folder: Path) -> Path:
    """197 logs in five folders, a corrupt one, an empty one and a foreign one."""
    for seed in range(197):
        still(folder / f"unit{seed % 5}" / f"{seed:03}.mcap", seed)
    whole = (folder / "unit0" / "000.mcap").read_bytes()
    (folder / "corrupt.mcap").write_bytes(whole[:8] + bytes(400) + whole[500:])
    (folder / "empty.mcap").touch()
    foreign(folder / "foreign.mcap")
    return folder


def here(tasks: Iterator[Task], count: int) -> Iterator[tuple[Task, Row | None]]:
    """Rows by this very process, which needs no start."""
    del count
    return ((task, row_of(task)) for task in tasks)


def rows_of(results: Path) -> list[dict[str, Any]]:
    """Rows of a folder of results without what depends on when and where they were made."""
    document = json.loads((results / "results.json").read_text())
    assert declared.problem(document, ResultsDocument, "results") == ""
    assert document["complete"]
    return [{key: value for key, value in row.items() if key not in TIMINGS} for row in document["rows"]]
