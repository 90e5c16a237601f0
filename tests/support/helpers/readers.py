"""Readers and validators of logs by others: what each of them finds. The judges of what is written.

Programs are run where they are installed, and never imported: `pymcap-cli` is under the GPL, `rerun` is large.
"""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from helpers.paths import ROOT
from helpers.processes import LIMIT_S
from imutui.logbook import schemas


def by_rosbags(path: Path) -> dict[str, int]:
    """Messages of each topic as rosbags finds them, each of them decoded."""
    found: Counter[str] = Counter()
    with AnyReader([path]) as bag:
        for connection, _, data in bag.messages():
            bag.deserialize(data, connection.msgtype)
            found[connection.topic] += 1
    return dict(found)


def by_mcap(path: Path) -> dict[str, int]:
    """As the container's own library finds them through the index, checksums checked."""
    with path.open("rb") as stream:
        return dict(Counter(c.topic for _, c, _ in make_reader(stream, validate_crcs=True).iter_messages()))


def by_typescript(path: Path) -> dict[str, int] | None:
    """As @mcap/core finds and decodes them; None where node or its packages are not there."""
    document = typescript_document(path)
    return None if document is None else {topic: found["count"] for topic, found in document["topics"].items()}


def typescript_document(path: Path) -> dict[str, Any] | None:
    """What `tests/foreign/read.mjs` prints of a log; None where node or its packages are not there."""
    modules = os.environ.get("NPM_READERS")
    if shutil.which("node") is None or modules is None:
        return None
    line = ["node", ROOT / "tests" / "foreign" / "read.mjs", path]
    done = subprocess.run(line, cwd=modules, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


READERS: dict[str, Callable[[Path], dict[str, int] | None]] = {
    "rosbags": by_rosbags,
    "mcap": by_mcap,
    "@mcap/core": by_typescript,
}


def packets_by_reader(path: Path) -> dict[str, int]:
    """Raw packets in a log, by the readers that are there."""
    found = {name: read(path) for name, read in READERS.items()}
    return {name: topics[schemas.RAW] for name, topics in found.items() if topics is not None}


def _tool(name: str) -> str | None:
    return shutil.which(name, path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))


@dataclass(frozen=True)
class Verdict:
    """What a validator says of a log: errors, warnings, and the texts of both."""

    errors: int
    warnings: int
    texts: tuple[str, ...]


def by_doctor(path: Path) -> Verdict | None:
    """Verdict of `pymcap-cli doctor`; None where it is not there. It warns of a publish time after the log time."""
    tool = _tool("pymcap-cli")
    if tool is None:
        return None
    line = [tool, "doctor", "--format", "jsonl", str(path)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    said = [json.loads(text) for text in done.stdout.splitlines() if text.startswith("{")]
    summary = next(one for one in said if one["type"] == "summary")
    grave = [one["message"] for one in said if one["type"] == "finding" and one["severity"] != "info"]
    return Verdict(summary["errors"], summary["warnings"], tuple(grave))


def by_rerun(path: Path) -> Verdict | None:
    """Verdict of `rerun mcap check`; None where it is not there."""
    tool = _tool("rerun")
    if tool is None:
        return None
    line = [tool, "mcap", "check", str(path)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    rows = [text for text in done.stdout.splitlines() if "/" in text and len(text.split()) > 3]
    issues = tuple(text for text in rows if not text.startswith("ok") and text.split()[1].isdigit())
    return Verdict(int(done.returncode != 0), len(issues), issues)


VALIDATORS: dict[str, Callable[[Path], Verdict | None]] = {"pymcap-cli doctor": by_doctor, "rerun mcap check": by_rerun}
