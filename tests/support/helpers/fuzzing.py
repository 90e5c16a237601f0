"""What is fuzzed, in one table: seeds that are right, how they are spoilt, and what takes them.

A target raises only what nobody documents: errors that a command tells in words of its own are what is wanted.
"""

import contextlib
import io
import json
import random
import shutil
import signal
import time
import tracemalloc
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from filters.errors import InputError
from helpers import traces
from helpers.logs import recorded
from helpers.mutations import spoilt_bytes, spoilt_log, spoilt_text
from imutui import config
from imutui.instrument.imu400.crossbow import Command, CommandDecoder, Mode, Packet, encode
from imutui.instrument.imu400.decoder import packet_decoder, reply_decoder
from imutui.jobs import check, info, operator_steps, page_data, recover, result_files
from imutui.logbook import effects_file, import_reference, reference_file
from imutui.logbook.importing import recording as recordings
from imutui.logbook.importing.table import ImportDataError
from imutui.logbook.importing.write import write
from imutui.logbook.json_text import dumps
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.session_info import SessionInfo
from imutui.report import logs as log_texts
from imutui.report import page
from imutui.scenario import ScenarioError, load_scenario

LIMIT_S = 20.0  # longest that one input may take


class NotDoneError(BaseException):
    """An input takes too long; nothing that takes one may take this for an error of its own."""


@dataclass(frozen=True, slots=True)
class Target:
    """Something that takes bytes from outside."""

    seeds: Callable[[Path], list[bytes]]  # gives inputs that are right; told a folder to work in
    spoil: Callable[[random.Random, bytes], bytes]  # makes another input of one
    file: str  # name of the file that an input is
    take: Callable[[Path], None]  # takes it; may work beside it
    in_tests: int  # inputs that take about a third of a second
    told: tuple[type[Exception], ...] = ()  # errors that are documented, and that a command tells in words

    def give(self, data: bytes, folder: Path) -> None:
        """Have an input taken, in a folder to work in."""
        path = folder / self.file
        path.write_bytes(data)
        self.take(path)


@dataclass(frozen=True, slots=True)
class Failure:
    """An input, the seed that makes it, and what came of it."""

    target: str
    seed: int
    data: bytes
    error: str


# ------------------------------------------------------------------------------------------------------------- targets


def _line_seeds(folder: Path) -> list[bytes]:
    packets = [Packet(Mode.SCALED, (k, -k, 1), (2, 3, 5450), 1587, 65535 - 75 * k) for k in range(9)]
    return [b"".join(map(encode, packets)), b"H" + b"\xff\x00\x97\x3c\xe6\xb9" + b"\xffDMU\x8a", b"PPRSvCGTab"]


def _take_line(path: Path) -> None:
    data = path.read_bytes()
    rng = random.Random(len(data))
    for command in (True, False, Command.PING, Command.VERSION, Command.SERIAL_NUMBER, Command.SCALED_MODE):
        packets = isinstance(command, bool)
        decoder = packet_decoder(Mode.SCALED, streaming=command) if packets else reply_decoder(command)
        for piece in _pieces(rng, data):
            for event in decoder.feed(piece):
                repr(event)
        decoder.quiet()
    unit = CommandDecoder()
    for piece in _pieces(rng, data):
        unit.feed(piece)


def _pieces(rng: random.Random, data: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(data):
        size = rng.choice((1, 3, 17, 200))
        yield data[at : at + size]
        at += size


def _log_seeds(folder: Path) -> list[bytes]:
    path = folder / "seed.mcap"
    path.unlink(missing_ok=True)
    made = recorded(path, seconds=2, rate=8).read_bytes()
    return [made, made[: len(made) * 2 // 3]]


def _still_log_seeds(folder: Path) -> list[bytes]:
    """Of a unit at rest, which a filter takes."""
    source, path = folder / "still.npz", folder / "still.mcap"
    np.savez(source, **_arrays())
    write(recordings.load(source), SessionInfo(accel_sign=1, mount="x,-y,-z"), path, overwrite=True)
    made = path.read_bytes()
    return [made, made[: len(made) * 2 // 3]]


def _take_brief(path: Path) -> None:
    from imutui.tui.pages.logs import text

    found = info.brief(path)
    text.rows([found], (), 140)
    text.detail(found)


def _told(take: Callable[[Path], Any], text: Callable[[Any, int], str]) -> Callable[[Path], None]:
    """What a command prints of a log, as JSON and as text."""

    def both(path: Path) -> None:
        document = take(path)
        dumps(document)
        text(document, 80)

    return both


def _recovered(path: Path) -> Any:
    return recover.recover(path, path.with_name("fixed.mcap"), overwrite=True)


def _take_replay(path: Path) -> None:
    from imutui.jobs.replay import EstimatesFile, replay
    from imutui.report import replay_text

    written = EstimatesFile(path.with_name("estimates.mcap"), overwrite=True)
    _told(lambda log: replay(log, output=written), replay_text.text)(path)


def _arrays() -> dict[str, np.ndarray]:
    t = np.arange(20) * 0.1
    still = np.tile([0.0, 0.0, 0.998], (20, 1))
    return {"t": t, "gyro": 0.0 * still, "accel": still, "temp": 20.0 + t, "ang": 0.0 * still, "extra": t}


def _npz_seeds(folder: Path) -> list[bytes]:
    made = []
    for save in (np.savez, np.savez_compressed):
        stream = io.BytesIO()
        save(stream, **_arrays())
        made.append(stream.getvalue())
    return made


def _spoilt_npz(rng: random.Random, data: bytes) -> bytes:
    """Bytes of the archive, or of one array in it, spoilt."""
    if rng.random() < 0.3:
        return spoilt_bytes(rng, data)
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(stream, "w") as new:
        names = old.namelist()
        chosen = rng.choice(names)
        for name in names:
            inside = old.read(name)
            if name == chosen:
                # the head is text
                head = spoilt_text(rng, inside[10:128]) if rng.random() < 0.6 else inside[10:128]
                whole = inside[:10] + head + inside[128:]
                inside = whole if rng.random() < 0.6 else spoilt_bytes(rng, whole)
            new.writestr(name, inside, rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))
    return stream.getvalue()


def _csv_seeds(folder: Path) -> list[bytes]:
    arrays = _arrays()
    rows = ["t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,temp"]
    columns = zip(arrays["t"], arrays["gyro"], arrays["accel"], arrays["temp"], strict=True)
    rows += [",".join(f"{v:.6g}" for v in (t, *gyro, *accel, temp)) for t, gyro, accel, temp in columns]
    return ["\n".join(rows).encode()]


def _take_import(path: Path) -> None:
    recording = recordings.load(path)
    session = SessionInfo()
    recordings.check_gravity(recording, session)
    made = import_reference.from_arrays(recording.known_t, recording.known, session.axes().mount, session.site())
    write(recording, session, path.with_name("imported.mcap"), overwrite=True, reference=made)


_SCENARIO = b"""\
seed = 3
power_ons = 2

[biases]
accel_mg = [1.0, -2.0, 3.0]
gyro_dps = [0.1, 0.0, -0.1]

[noise]

[temperature]
history = [[0.0, 20.0], [600.0, 35.0]]

[site]
latitude_deg = -23.2
longitude_deg = -45.9
height_m = 641.0

[instrument]
accel_sign = -1
mount = "x,-y,-z"

[[effect]]
name = "thermal_lin"
channel = "gy"
dps_per_k = 0.02

[[power_on]]
seed = 5

[[fault]]
at_s = 3.0
kind = "drop_bytes"
count = 4

[[profile.segment]]
kind = "dwell"
angles_deg = [0.0, 90.0, 0.0]
seconds = 30.0
"""


def _take_scenario(path: Path) -> None:
    from filters.simulation import Unit

    scenario = load_scenario(path)
    try:
        Unit(scenario, 0, 20.0).record(20)
    except InputError as error:
        raise ScenarioError(str(error)) from error


_PROFILE = b"""\
align = "marks"
sign = [1, 1, -1]
offset_sd_s = 0.05
slew_dps = 20.0
accel_dps2 = 100.0

[[segment]]
kind = "dwell"
angles_deg = [0.0, 90.0, 0.0]
seconds = 30.0

[[segment]]
kind = "rate"
axis = "inner"
rate_dps = 30.0
seconds = 12.0

[[segment]]
kind = "sine"
axis = "middle"
amplitude_deg = 10.0
hz = 0.5
seconds = 20.0
"""
_ANGLES = b"t,outer,middle,inner\n0,0,0,0\n1,0,1.5,0\n2,0,3,10\n3,0,3,20\n4,0,3,20\n"
_TRAJECTORY = (
    b"t,lat,lon,h,vn,ve,vd,roll,pitch,yaw\n0,-23.2,-45.9,641,0,0,0,0,0,0\n1,-23.2,-45.9,641,1,0,0,,,\n"
    b"2,-23.2,-45.9,641,2,0,0,0,1,2\n"
)


def _take_profile(path: Path) -> None:
    offer = operator_steps.offer_of(path)
    if offer.error:
        return
    profile = operator_steps.load(offer.file, offer.text)
    operator_steps.steps(profile)
    dumps(operator_steps.document(profile, offer.name, operator_steps.steps(profile)))
    reference_file.parse(path.name, path.read_bytes())


def _take_reference(path: Path) -> None:
    import_reference.from_file(path).motion()


_EFFECTS = b"""\
version = 1
source = "trace of a.mcap"
correlation = [[1.0, 0.1], [0.1, 1.0]]

[[effect]]
effect = "thermal_lin"
channels = ["gy"]
include_as = "A"

[[effect.state]]
name = "k"
unit = "deg/s/K"
mean = 0.02
sd = 0.001

[[effect]]
effect = "thermal_lag"
channels = ["gx"]
include_as = "A"

[effect.parameters]
tau_s = 80.0

[[effect.state]]
name = "k"
unit = "deg/s/K"
mean = 0.02
sd = 0.001
tau_s = inf
q = 0.0
"""


def _take_effects(path: Path) -> None:
    effects_file.maker(effects_file.from_file(path), SessionInfo(rate_hz=20.0))


_CONFIGURATION = (
    b'[paths]\nlogs = "logs"\n\n[acquisition]\nrate_hz = 20.0\noperator = "ana"\n\n[site]\nheight_m = 641.0\n'
)


_PROFILE_TEXT = json.dumps(_PROFILE.decode())
_REQUESTS = (
    b'{"ask": "snapshot", "since": 0}',
    b'{"ask": "mark", "text": "table at 90"}',
    b'{"ask": "record", "wish": {"note": "x", "operator": "ana", "rotate_minutes": 5.0, "rotate_mb": null}}',
    b'{"ask": "configure", "changes": {"reference": "gravity", "effects": ""}}',
    b'{"ask": "configure", "changes": {"reference_file": ["t.toml", ' + _PROFILE_TEXT.encode() + b"]}}",
    b'{"ask": "configure", "changes": {"effects": ' + json.dumps(_EFFECTS.decode()).encode() + b"}}",
    b'{"ask": "zero", "argument": 0}',
    b'{"ask": "statistics", "channel": 6}',
    b'{"ask": "begin_statistics"}',
    b'{"ask": "profile"}',
    b'{"ask": "guide", "do": "begin", "wish": {"note": "y"}}',
    b'{"ask": "stop_recording"}',
    b'{"ask": "wait", "timeout_s": 0.5}',
)
_SEQUENCES = tuple(
    b"\n".join(_REQUESTS[k] for k in order) for order in ((2, 1, 11), (4, 10, 0, 1, 9, 7), (5, 2, 0, 11, 3, 0))
)


class _Unit:
    """Stands where an acquisition has its reader."""

    last_packet_ns = 0

    def be_watched(self) -> None:
        pass

    def zero(self, argument: int) -> None:
        if not 0 <= argument <= 255:
            raise AssertionError(argument)


class _Engine:
    """An acquisition without threads: what is asked is done at once, as its worker does it."""

    def __init__(self, folder: Path) -> None:
        from imutui.session.acquisition import Acquisition
        from imutui.session.lifecycle import Lifecycle
        from imutui.session.plan import Plan

        self.result, self.ended_by_itself, self.lifecycle = None, True, Lifecycle()
        self.lifecycle.first_packet()
        plan = Plan("virtual", rate_hz=20.0, logs=str(folder))
        session = SessionInfo(rate_hz=20.0, kind="simulated", serial_number="7")
        self.acquisition = Acquisition(plan, session, _Unit(), self.lifecycle)  # type: ignore[arg-type]
        # nobody is waited for
        self.lifecycle.ended.set()

    def call(self, function: Callable[[Any], Any], timeout: float = 30.0, *, late: bool = False) -> Any:
        return function(self.acquisition)

    def zero(self, argument: int, timeout: float = 30.0) -> str:
        from imutui.instrument.imu400.driver import Imu400cd

        Imu400cd.check_zeroing(argument)
        self.acquisition.begin_zeroing(argument)
        return ""

    def request_stop(self, by: str) -> None:
        pass


def _take_request(path: Path) -> None:
    from imutui.session import ipc, requests

    folder, logs = path.parent, path.with_name("logs")
    before = {path for path in folder.rglob("*") if not path.is_relative_to(logs)}
    engine = _Engine(logs)
    for line in (*path.read_bytes().split(b"\n")[:20], _REQUESTS[0], _REQUESTS[-2]):
        reply = ipc.reply_to(line, lambda request: requests.carry_out(engine, request))  # type: ignore[arg-type]
        json.dumps(reply)
        if not reply["ok"] and "a defect of imutui" in reply["error"]:
            raise AssertionError(reply["error"])
    engine.acquisition.recording.finish()
    if {path for path in folder.rglob("*") if not path.is_relative_to(logs)} != before:
        raise AssertionError("a request wrote outside of the folder of logs")
    shutil.rmtree(logs, ignore_errors=True)


def _result_seeds(folder: Path) -> list[bytes]:
    document = {**traces.whole_document(), "curves": []}
    return [json.dumps(document).encode(), (Path(__file__).with_name("replay_result.json")).read_bytes()]


def _take_result(path: Path) -> None:
    found, _ = result_files.completed(result_files.read(path))
    page.page([page.Story(d, page_data.of_result(d)) for d in found])


def _given(*seeds: bytes) -> Callable[[Path], list[bytes]]:
    return lambda folder: list(seeds)


# by the names that cases begin with
TARGETS = {
    "line": Target(_line_seeds, spoilt_bytes, "line", _take_line, 900),
    "brief": Target(_log_seeds, spoilt_log, "log.mcap", _take_brief, 300),
    "info": Target(
        _log_seeds, spoilt_log, "log.mcap", _told(info.info, log_texts.info_text), 150, (UnreadableLogError,)
    ),
    "check": Target(
        _log_seeds, spoilt_log, "log.mcap", _told(check.check, log_texts.check_text), 150, (UnreadableLogError,)
    ),
    "recover": Target(
        _log_seeds, spoilt_log, "log.mcap", _told(_recovered, log_texts.recover_text), 60, (UnreadableLogError,)
    ),
    "replay": Target(_still_log_seeds, spoilt_log, "log.mcap", _take_replay, 40, (InputError,)),
    "npz": Target(_npz_seeds, _spoilt_npz, "recording.npz", _take_import, 150, (ImportDataError,)),
    "csv": Target(_csv_seeds, spoilt_text, "recording.csv", _take_import, 200, (ImportDataError,)),
    "scenario": Target(_given(_SCENARIO), spoilt_text, "scenario.toml", _take_scenario, 200, (ScenarioError,)),
    "profile": Target(_given(_PROFILE), spoilt_text, "profile.toml", _take_profile, 60),
    "angles": Target(_given(_ANGLES), spoilt_text, "profile.csv", _take_profile, 60),
    "trajectory": Target(_given(_TRAJECTORY), spoilt_text, "trajectory.csv", _take_reference, 300, (ImportDataError,)),
    "effects": Target(_given(_EFFECTS), spoilt_text, "effects.toml", _take_effects, 400, (InputError,)),
    "request": Target(_given(*_REQUESTS, *_SEQUENCES), spoilt_text, "requests", _take_request, 80),
    "result": Target(_result_seeds, spoilt_text, "result.json", _take_result, 60, (UnreadableLogError,)),
    "configuration": Target(
        _given(_CONFIGURATION),
        spoilt_text,
        "imutui.toml",
        lambda path: config.load({}, path.parent),
        400,
        (InputError,),
    ),
}


# ------------------------------------------------------------------------------------------------------------- running


def take(name: str, data: bytes, folder: Path) -> None:
    """Give a target an input, within a time.

    Raises Exception: what is not documented.
    Raises NotDoneError if it takes too long.
    """
    target = TARGETS[name]
    # a warning would stand on a user's terminal, too
    with contextlib.suppress(*target.told), _within(LIMIT_S), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        target.give(data, folder)


@contextlib.contextmanager
def _within(seconds: float) -> Iterator[None]:
    def over(*_: object) -> None:
        raise NotDoneError(f"not done after {seconds:.0f} s")

    before = signal.signal(signal.SIGALRM, over)
    rest = signal.setitimer(signal.ITIMER_REAL, seconds)[0]
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, rest)
        signal.signal(signal.SIGALRM, before)


def memory_of(name: str, data: bytes, folder: Path) -> int:
    """Most memory that taking an input has, bytes; without the modules that the first one loads."""
    before = folder / "before"
    before.mkdir(exist_ok=True)
    take(name, TARGETS[name].seeds(before)[0], before)
    tracemalloc.start()
    try:
        take(name, data, folder)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def campaign(name: str, seeds: Iterator[int], folder: Path, until: float = float("inf")) -> Iterator[Failure]:
    """Spoil a target's inputs, one a seed, until a time (monotonic, s); what failed, as it fails."""
    work = folder / name
    work.mkdir(parents=True, exist_ok=True)
    target = TARGETS[name]
    given = target.seeds(work)
    for seed in seeds:
        if time.monotonic() > until:
            return
        rng = random.Random(f"{name} {seed}")
        data = target.spoil(rng, rng.choice(given))
        try:
            take(name, data, work)
        except (Exception, NotDoneError) as error:  # noqa: BLE001 - that is what is looked for
            yield Failure(name, seed, data, f"{type(error).__name__}: {error}")
    shutil.rmtree(work, ignore_errors=True)
