"""`imutui check`."""

from pathlib import Path
from typing import Annotated

import typer

from imutui.cli.each_log import over
from imutui.cli.options import (
    AccelSign,
    Gravity,
    GyroSign,
    Json,
    Mount,
    SiteText,
    StampsOf,
    Topic,
    reading_of,
)


def command(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs, finished or not.")],
    topic: Topic = None,
    stamps: StampsOf = None,
    mount: Mount = None,
    accel_sign: AccelSign = None,
    gyro_sign: GyroSign = None,
    site: SiteText = None,
    gravity: Gravity = None,
    json: Json = False,
) -> None:
    """Look logs through: is the file whole, and do its parts agree.

    Checksums, the SHA-256 beside the file, index, every message; times, numbers, packets lost, samples against packets,
    gaps, limits, health of the channels, metadata, reference. Each finding says what, where, and what to do next.

    Exit code 0: fine, 1: findings, 3: unreadable.

    Example: imutui check logs/*.mcap
    """
    from imutui.jobs.check import check
    from imutui.report.logs import check_text

    reading = reading_of(
        topic=topic,
        stamps=stamps,
        mount=mount,
        accel_sign=accel_sign,
        gyro_sign=gyro_sign,
        site=site,
        gravity=gravity,
    )
    over(
        logs,
        lambda path, show: check(path, show, reading),
        check_text,
        json=json,
        fine=lambda document: bool(document["fine"]),
    )
