"""What each command makes of bad arguments and bad files: one table a command, run in this process to be quick."""

import io
import json
import os
import pickle
import random
import signal
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.commands import Done, imutui, imutui_json
from helpers.logs import foreign
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from imutui.logbook import SessionInfo
from imutui.logbook.writer import LogWriter

START_NS = 1_700_000_000_000_000_000
KEPT = b"not to be overwritten"
EFFECTS = 'version = 1\n[[effect]]\neffect = "gremlins"\nchannels = ["gy"]\ninclude_as = "A"\n'
"""An effects file that is one, but for the effect that nobody knows."""


@pytest.fixture(autouse=True)
def handlers(home: Path) -> Iterator[None]:
    """Files are relative to the test's own folder; a virtual unit that begins takes signals, which are given back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run(*arguments: str) -> Done:
    """How a command line ends, whatever its exit code."""
    return imutui(*arguments, check=None)


def error(done: Done, code: int) -> str:
    """The error of a command, one paragraph on stderr and nothing on stdout, after checking the exit code."""
    assert done.returncode == code, done
    assert done.stdout == ""
    assert "a defect of imutui" not in done.stderr
    *before, last = done.stderr.splitlines()
    told = ("imutui: not imported", "imutui: warning")
    assert all(line.startswith(told) or "assumed: " in line or "the site is not stated" in line for line in before), (
        done.stderr
    )
    assert last.startswith("imutui: ")
    return last


def test_status_with_nothing_running_is_fine() -> None:
    done = imutui("status")
    assert (done.stdout, done.stderr) == ("no acquisition is running\n", "")
    assert imutui_json("status") == []


@pytest.mark.parametrize("line", ["recrod", "mark", "replay", "import a.npz"])
def test_a_command_line_that_cannot_be_parsed_is_usage(line: str) -> None:
    outcome = run(*line.split(" "))
    assert outcome.returncode == 2
    assert outcome.stdout == ""
    assert "-h' for help" in outcome.stderr


@pytest.mark.parametrize(
    "text", ["[acquisition", "[acquisition]\nrate_hz = 'fast'\n", "[instrument]\naccel_sign = 'up'\n"]
)
def test_a_configuration_that_cannot_be_read_is_named_with_its_file(home: Path, text: str) -> None:
    (home / "imutui.toml").write_text(text)
    assert "imutui.toml" in error(run("record", "--port", "/dev/no-such-port"), 2)


def test_a_misspelt_setting_in_a_file_is_said_by_the_command_that_would_use_it(home: Path) -> None:
    """`rate` for `rate_hz` must not quietly mean the default."""
    (home / "imutui.toml").write_text("[acquisition]\nrate = 20\n")
    assert "acquisition.rate" in run("record", "--port", "/dev/no-such-port").stderr


# -- import -----------------------------------------------------------------------------------------------------------

N = 40
HEADER = "t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n"
ROWS = "".join(f"{i / 20},0,0,0,0,0,0.998\n" for i in range(5))


def arrays(**changes: Any) -> dict[str, Any]:
    """A still, level recording with the Crossbow's sign, but for changes."""
    level = np.tile([0.0, 0.0, 0.998], (N, 1))
    return {"t": np.arange(N) / 20.0, "gyro": np.zeros((N, 3)), "accel": level} | changes


def npz(**changes: Any) -> bytes:
    """As the bytes of an NPZ file; None leaves an array out."""
    stream = io.BytesIO()
    np.savez(stream, **{name: array for name, array in arrays(**changes).items() if array is not None})
    return stream.getvalue()


def zipped(**texts: str) -> bytes:
    """A zip file of text files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, text in texts.items():
            archive.writestr(name, text)
    return stream.getvalue()


def npy() -> bytes:
    """A single array, as numpy.save writes it."""
    stream = io.BytesIO()
    np.save(stream, np.zeros(3))
    return stream.getvalue()


def spoilt(array: np.ndarray, row: int, value: float) -> np.ndarray:
    """Copy of an array with one row replaced."""
    copy = array.copy()
    copy[row] = value
    return copy


def damaged_member() -> bytes:
    """A compressed NPZ with a byte changed in the middle of its data."""
    stream = io.BytesIO()
    rng = np.random.default_rng(4)
    np.savez_compressed(stream, **arrays(gyro=rng.normal(size=(N, 3))))
    data = bytearray(stream.getvalue())
    with zipfile.ZipFile(stream) as archive:
        member = archive.getinfo("gyro.npy")
    data[member.header_offset + 60] ^= 0xFF
    return bytes(data)


# name, content, and what the error must say; tests/logbook/test_importer.py has more that arrays may have wrong
IMPORTS: dict[str, tuple[str, bytes, tuple[str, ...]]] = {
    "a stamp that is far off": ("a.npz", npz(t=spoilt(arrays()["t"], 30, 1e9)), ("row 30", "later", "--drop 30")),
    "time in nanoseconds": ("a.npz", npz(t=np.arange(N) * 5e7), ("`t`", "s")),
    "misspelt array": ("a.npz", npz(gyro=None, gryo=np.zeros((N, 3))), ("no `gyro`", "gryo")),
    "no rows": ("a.npz", npz(t=np.zeros(0), gyro=np.zeros((0, 3)), accel=np.zeros((0, 3))), ("0 samples",)),
    "pickled objects": ("a.npz", npz(accel=np.array([[1, 2, {}]] * N, dtype=object)), ("accel", "numpy.savez")),
    "a pickle": ("a.npz", pickle.dumps({"t": 1}), ("NPZ", "numpy.savez")),
    "a single vector": ("a.npy", npy(), ("shape (3,)", "(N, 7)")),
    "a zip of text": ("a.npz", zipped(**{"readme.txt": "x"}), ("no `t`", "readme.txt")),
    "a zip of text so named": ("a.npz", zipped(t="x", gyro="x", accel="x"), ("`t`",)),
    "a damaged member": ("a.npz", damaged_member(), ("a.npz",)),
    "an empty NPZ": ("a.npz", b"", ("NPZ",)),
    "plain text": ("a.npz", b"hello\n", ("NPZ", ".csv")),
    "an empty CSV": ("a.csv", b"", ("empty", "gyro_x")),
    "a CSV of names only": ("a.csv", HEADER.encode(), ("0 samples",)),
    "a CSV with text": (
        "a.csv",
        (HEADER + ROWS + "0.5,a,0,0,0,0,1\n").encode(),
        ("row 5", "gyro_x", '"a"', "--drop 5"),
    ),
    "a short CSV row": ("a.csv", (HEADER + ROWS + "0.5,0\n").encode(), ("line 7", "2 cells", "--drop 5")),
    "a CSV without names": ("a.csv", ROWS.encode(), ("no `t`",)),
    "a misspelt column": ("a.csv", (HEADER.replace("gyro_z", "gryo_z") + ROWS).encode(), ("no `gyro`", "gryo_z")),
    "binary as CSV": ("a.csv", bytes(range(256)), ("CSV",)),
}


@pytest.mark.parametrize("case", IMPORTS)
def test_a_recording_that_cannot_be_imported_is_named_with_its_row(home: Path, case: str) -> None:
    name, content, words = IMPORTS[case]
    (home / name).write_bytes(content)
    said = error(run("import", name, "-o", "out.mcap"), 3)
    assert all(part in said for part in (name, *words)), said
    assert not (home / "out.mcap").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"t": np.arange(600) * 1e-9}, "less than a microsecond"),
        ({"gyro": np.full((600, 3), 1e7)}, "beyond ±100,000 deg/s"),
        ({"temp": np.full(600, -1e6)}, "which is no temperature in degC"),
    ],
)
def test_what_no_command_would_read_is_not_imported(home: Path, changes: dict[str, Any], words: str) -> None:
    rows = {"t": np.arange(600) / 20.0, "gyro": np.zeros((600, 3)), "accel": np.tile([0.0, 0.0, 1.0], (600, 1))}
    np.savez(home / "x.npz", **(rows | changes))
    assert words in error(run("import", "x.npz", "-o", "x.mcap"), 3)


def test_the_advice_to_take_a_part_without_the_bad_rows_works(home: Path) -> None:
    """The part before a bad stamp is a recording like any other."""
    (home / "a.npz").write_bytes(npz(t=spoilt(arrays()["t"], 30, 1e9)))
    assert run("import", "a.npz", "-o", "out.mcap", "--end", "1.0").returncode == 0


def test_an_array_of_objects_that_nobody_needs_is_left_aside(home: Path) -> None:
    (home / "a.npz").write_bytes(npz(notes=np.array({"table": 1}, dtype=object)))
    outcome = run("import", "a.npz", "-o", "out.mcap")
    assert outcome.returncode == 0, outcome
    assert "notes" in outcome.stderr


def test_a_blank_last_line_of_a_csv_is_no_row(home: Path) -> None:
    """Spreadsheets and editors leave one."""
    (home / "a.csv").write_text(HEADER + ROWS + "\n")
    assert run("import", "a.csv", "-o", "out.mcap").returncode == 0


# -- replay -----------------------------------------------------------------------------------------------------------

SAMPLES, A_FLUSH = 12, 4


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small log: twelve samples, four to a flush."""
    path = tmp_path_factory.mktemp("log") / "small.mcap"
    writer = LogWriter(path, SessionInfo(rate_hz=4.0), "# made here\n", START_NS)
    for k in range(SAMPLES):
        stamp = START_NS + k * 250_000_000
        writer.imu(stamp, stamp, np.zeros(3), np.array([0.0, 0.0, -9.78]))
        if k % A_FLUSH == A_FLUSH - 1:
            writer.flush()
    writer.finish({}, START_NS)
    return path.read_bytes()


def chunks(content: bytes) -> list[tuple[int, int, int]]:
    """Start, end and samples of each chunk of a log."""
    stream, out, start = io.BytesIO(content), [], 8
    samples_of: set[int] = set()
    for record in StreamReader(stream, emit_chunks=True).records:
        if isinstance(record, Chunk):
            parts = breakup_chunk(record)
            samples_of |= {part.id for part in parts if isinstance(part, Channel) and part.topic == "/imu/data_raw"}
            samples = sum(isinstance(part, Message) and part.channel_id in samples_of for part in parts)
            out.append((start, stream.tell(), samples))
        start = stream.tell()
    return out


def edges(content: bytes) -> list[int]:
    """Where records begin, and one byte to either side; the first bytes; and a seeded choice of the rest."""
    at, found = 8, set(range(12))
    while at + 9 < len(content) - 8:
        found |= {at - 1, at, at + 1, at + 9}
        at += 9 + int.from_bytes(content[at + 1 : at + 9], "little")
    found |= set(random.Random(6).sample(range(len(content)), 25)) | set(range(len(content) - 12, len(content)))
    return sorted(found)


def test_every_prefix_of_a_log_replays_or_says_that_nothing_can_be_read(home: Path, log: bytes) -> None:
    for length in edges(log):
        (home / "cut.mcap").write_bytes(log[:length])
        outcome = run("replay", "cut.mcap", "--json")
        samples = sum(n for _, end, n in chunks(log) if end <= length)
        if not samples:
            assert "cut.mcap" in error(outcome, 3)
            continue
        assert outcome.returncode == 1, (length, outcome)
        document = json.loads(outcome.stdout)
        assert document["samples"] == samples, length
        assert document["finished"] is False, length
        assert "cut.mcap" in outcome.stderr
        if any(start < length < end for start, end, _ in chunks(log)):
            assert "ends in the middle" in outcome.stderr, length
            assert "`imutui recover cut.mcap -o FIXED.mcap` makes a whole file" in outcome.stderr


def test_a_changed_byte_in_a_chunk_is_noticed_and_all_before_it_is_used(home: Path, log: bytes) -> None:
    rng = random.Random(8)
    before = [sum(n for _, _, n in chunks(log)[:i]) for i in range(len(chunks(log)))]
    for (start, end, n), samples in zip(chunks(log), before, strict=True):
        for at in rng.sample(range(start + 60, end), 6):
            damaged = bytearray(log)
            damaged[at] ^= 1 << rng.randrange(8)
            (home / "bad.mcap").write_bytes(damaged)
            outcome = run("replay", "bad.mcap", "--json")
            if not samples:
                assert "bad.mcap" in error(outcome, 3)
                continue
            assert outcome.returncode == 1
            document = json.loads(outcome.stdout)
            assert document["samples"] == samples
            assert document["damage"]
            assert n


FOREIGN_FILES = {
    "text.mcap": b"hello world\n" * 20,
    "short text.mcap": b"hi\n",
    "picture.mcap": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "archive.mcap": zipped(**{"readme.txt": "x"}),
}


@pytest.mark.parametrize("name", FOREIGN_FILES)
def test_a_file_that_is_no_log_is_called_so(home: Path, name: str) -> None:
    (home / name).write_bytes(FOREIGN_FILES[name])
    said = error(run("replay", name, "--json"), 3)
    assert name in said
    assert "not an MCAP log: its first bytes are not an MCAP file's" in said
    assert "imutui import" in said


PIPES = (
    *("replay x.mcap", "trace x.mcap", "info x.mcap", "check x.mcap", "recover x.mcap -o o.mcap"),
    *("export x.mcap --format csv -o o.csv", "apply x.mcap --effects x.mcap -o o.mcap", "note --log x.mcap warm"),
    *("replay log.mcap --effects x.mcap", "trace log.mcap --holdout x.mcap", "import x.mcap -o o.mcap"),
    *("import x.npz -o o.mcap", "import x.csv -o o.mcap", "virtual --from x.mcap", "virtual --scenario x.mcap"),
    *(
        "record --batch x.mcap",
        "report x.mcap -o page",
        "report --batch B7 x.mcap -o page",
        "campaign --summary x.mcap",
    ),
    *("profile x.csv", "replay log.mcap --reference x.csv"),
)
"""What opens files, given a pipe in the place of each."""


@pytest.mark.parametrize("line", PIPES)
def test_a_pipe_that_nothing_writes_into_is_refused_and_not_waited_for(home: Path, log: bytes, line: str) -> None:
    (home / "log.mcap").write_bytes(log)
    for name in ("x.mcap", "x.npz", "x.csv"):
        os.mkfifo(home / name)
    done = run(*line.split())
    assert done.returncode in (2, 3, 5), done
    assert "pipe" in done.stderr or "no file" in done.stderr, done
    assert "a defect of imutui" not in done.stderr


def test_a_pipe_among_logs_is_one_row_of_a_journal_that_is_enough_for_a_summary(home: Path, log: bytes) -> None:
    (home / "log.mcap").write_bytes(log)
    os.mkfifo(home / "x.mcap")
    done = imutui("campaign", ".", "-o", "results", "--workers", "1", check=None)
    assert done.returncode == 1
    assert "x.mcap: is a pipe, not a file" in done.stdout
    assert "2 logs, 1 with an error" in done.stdout
    document = imutui_json("campaign", "--summary", "results")
    (home / "results" / "results.json").unlink()
    assert imutui_json("campaign", "--summary", "results") == document | {"results": "results/rows.jsonl"}
    assert imutui_json("campaign", "--summary", "results/rows.jsonl") == document | {"results": "results/rows.jsonl"}


def test_an_imu_channel_of_any_topic_is_replayed(home: Path) -> None:
    foreign(home / "theirs.mcap")
    document = json.loads(run("replay", "theirs.mcap", "--json").stdout)
    assert document["samples"] == 60
    assert document["rate_hz"] == pytest.approx(20.0)


def test_a_foreign_message_that_cannot_be_decoded_is_left_out_and_counted(home: Path) -> None:
    foreign(home / "theirs.mcap", cut=40)
    document = json.loads(run("replay", "theirs.mcap", "--json").stdout)
    assert document["samples"] == 59
    assert "messages that cannot be decoded are left out: 1" in document["assumed"]


def test_a_foreign_reading_that_is_no_number_is_no_reading(home: Path) -> None:
    foreign(home / "theirs.mcap", spoil=np.nan)
    document = json.loads(run("replay", "theirs.mcap", "--json").stdout)
    assert document["samples"] == 59
    assert "1 sample with NaN hold no reading" in document["assumed"]


FOREIGN_LOGS: dict[str, tuple[dict[str, Any], int, tuple[str, ...]]] = {
    "no Imu": ({"typename": "std_msgs/msg/String"}, 3, ("sensor_msgs/msg/Imu", "/sensor/imu")),
    "Imu as JSON": ({"encoding": "json"}, 2, ("sensor_msgs/msg/Imu", "CDR", "`imutui import theirs.mcap")),
    "an endless reading": ({"spoil": np.inf}, 3, ("sample 30",)),
    "time standing still": ({"step_ns": 0}, 2, ("stand still",)),
}


@pytest.mark.parametrize("case", FOREIGN_LOGS)
def test_a_foreign_log_that_cannot_be_filtered_is_named_with_the_place(home: Path, case: str) -> None:
    how, code, words = FOREIGN_LOGS[case]
    foreign(home / "theirs.mcap", **how)
    said = error(run("replay", "theirs.mcap", "--json"), code)
    assert all(word in said for word in ("theirs.mcap", *words)), said


def test_one_logs_trouble_is_not_the_others(home: Path, log: bytes) -> None:
    (home / "good.mcap").write_bytes(log)
    outcome = run("replay", "good.mcap", "missing.mcap", "--json")
    assert outcome.returncode == 3
    assert "missing.mcap: no such file" in outcome.stderr
    assert [document["log"] for document in json.loads(outcome.stdout)] == [str(home / "good.mcap")]


# -- command lines -----------------------------------------------------------------------------------------------------

REFUSED = {
    "": {
        "stop": (4, "is running", "`imutui record`"),
        "stop --json": (4, "is running", "`imutui record`"),
        "mark x": (4, "is running", "`imutui record`"),
        "attach": (4, "is running", "`imutui record`"),
        "attach --name q": (4, "is running", "`imutui record`"),
        "status --name q": (4, "is running", "`imutui record`"),
        "stop --name q": (4, "is running", "`imutui record`"),
    },
    "record --port /dev/no-such-port --json": {
        "--instrument imu381 --rate 120": (2, "the IMU381ZA gives 0.1 to 100 Hz"),
        "--rate 200": (2, "the IMU400CD-200 gives 0.1 to 133 Hz, the IMU381ZA gives 0.1 to 100 Hz"),
        "--rate 0": (2, "0.1 to 133 Hz"),
        "--rate 0.0999": (2, "0.1 to 133 Hz"),
        "--rate 133.01": (2, "0.1 to 133 Hz"),
        "--rate -20": (2, "0.1 to 133 Hz"),
        "--rate fast": (2, '--rate is "fast", not a number. Output rate, 0.1 to 133 Hz.'),
        "--rate nan": (2, "not a finite number"),
        "--rate inf": (2, "not a finite number"),
        "--sampling sometimes": (2, "stream, polled"),
        "--reference upright": (2, "level, gravity"),
        "--mount x,y": (2, "x,-y,-z"),
        "--mount x,x,z": (2, "mount"),
        "--mount x,y,-z": (2, "left-handed"),
        "--gyro-sign 2": (2, "-1,1,1"),
        "--gyro-sign 1,1": (2, "-1,1,1"),
        "--accel-sign 0": (2, "-1, 1"),
        "--site 1,2": (2, "LAT,LON,H"),
        "--site here": (2, "LAT,LON,H"),
        "--site 91,0,0": (2, "latitude"),
        "--site nan,0,0": (2, "latitude"),
        "--site 0,0,nan": (2, "height"),
        "--site 0,0,inf": (2, "height"),
        "--gravity nan": (2, "gravity"),
        "--gravity -9.8": (2, "gravity"),
        "--filter kalman": (2, "spkf"),
        "--duration 0": (2, "positive"),
        "--duration nan": (2, "not a finite number"),
        "--duration 1e999": (2, "not a finite number"),
        "--baud 0": (2, "baud"),
        "--baud -5": (2, "baud"),
        "--name a/b": (2, "name"),
        "--name ..": (2, "name"),
        "--name " + "n" * 300: (2, "name"),
        "-o kept": (2, "--force"),
        "-o folder": (2, "folder is a folder"),
        "--effects missing.toml": (2, "missing.toml: No such file"),
        "--effects folder": (2, "folder: Is a directory"),
        "--effects kept": (2, "this is not"),
        "--effects newer.toml": (2, "its version is 2, not 1", "imutui trace LOG... -o effects.toml"),
        "--effects gremlins.toml": (2, "gremlins"),
    },
    "import": {
        "missing.npz -o out.mcap": (3, "missing.npz", "No such file"),
        "missing.csv -o out.mcap": (3, "missing.csv", "No such file"),
        "folder -o out.mcap": (3, "folder"),
        "good.npz -o kept": (2, "kept exists", "--force"),
        "good.npz -o kept/out.mcap": (5, "kept", "folder"),
        "good.npz -o good.npz --force": (2, "good.npz", "itself"),
        "good.npz -o out.mcap --start 100": (3, "--start", "1.950 s"),
        "good.npz -o out.mcap --start 1 --end 0.5": (3, "--start", "--end"),
        "good.npz -o out.mcap --kind real": (2, "measured"),
        "good.npz -o out.mcap --gravity nan": (2, "gravity"),
        "good.npz -o out.mcap --gravity -9.8": (2, "gravity"),
        "good.npz -o out.mcap --site 0,0,nan": (2, "height"),
        "good.npz -o out.mcap --accel-sign +1": (3, "--accel-sign -1", "--mount x,-y,-z", "its z is up"),
        "good.npz -o out.mcap --mount x,-y,-z": (3, "--accel-sign +1", "--mount x,y,z", "its z is up"),
    },
    "replay --json": {
        "missing.mcap": (3, "missing.mcap", "no such file"),
        "folder": (3, "folder", "is a folder"),
        "empty.mcap": (3, "empty.mcap", "0 bytes"),
        "good.mcap --set filter.noise=guess": (2, "guess", "table1, log"),
        "good.mcap --reference missing.toml": (3, "missing.toml", "No such file"),
        "good.mcap --reference profile": (2, "good.mcap", "--reference FILE"),
        "good.mcap --estimates -1": (2, "--estimates"),
        "good.mcap --start 100": (2, "--start", "2.750 s"),
        "good.mcap --start 2 --end 1": (2, "--end"),
        "good.mcap --set filter.kapa=1": (2, "filter.kapa", "filter.kappa"),
        "good.mcap --set filter.kappa": (2, "key=value"),
        "good.mcap --set filter.kappa=x": (2, "filter.kappa", "'x'"),
        "good.mcap --set filter.kappa=-100": (2, "kappa"),
        "good.mcap --set instrument.mount=x": (2, "instrument.mount", "filter.kappa"),
        "good.mcap --set site.gravity_mps2=nan": (2, "gravity"),
        "good.mcap --set site.gravity_mps2=-9.8": (2, "gravity"),
        "good.mcap --set filter.measurements=drawn --set filter.seed=-1": (2, "seed"),
        "good.mcap --filter kalman": (2, "spkf"),
        "good.mcap --reference upright": (2, "level, gravity"),
        "good.mcap --speed 0": (2, "--speed", "positive"),
        "good.mcap -o kept": (2, "kept exists", "--force"),
        "good.mcap -o good.mcap": (2, "itself"),
        "good.mcap -o good.mcap --force": (2, "itself"),
        "good.mcap -o symbolic.mcap --force": (2, "itself"),
        "good.mcap -o hard.mcap --force": (2, "itself"),
        "good.mcap good.mcap -o out.mcap": (2, "one log"),
        "good.mcap -o folder --force": (2, "folder is a folder", "-o names a file"),
        "good.mcap -o kept/out.mcap": (5, "kept", "folder"),
        "good.mcap --effects missing.toml": (2, "--effects missing.toml", "No such file", "imutui trace"),
        "good.mcap --effects kept": (2, "--effects kept", "this is not"),
        "good.mcap --effects newer.toml": (2, "--effects newer.toml", "its version is 2, not 1"),
        "good.mcap --effects gremlins.toml -o out.mcap": (2, "good.mcap", "gremlins", "--effects none"),
    },
    "virtual --while-stdin": {
        "--link kept": (2, "kept", "not a symbolic link"),
        "--link folder": (2, "folder", "not a symbolic link"),
        "--link nowhere/imu": (5, "nowhere"),
        "--from missing.npz": (3, "missing.npz"),
        "--from missing.mcap": (3, "missing.mcap"),
        "--from kept": (3, "kept", "NPZ"),
        "--from folder": (3, "folder"),
        "--from still.npz --from-start 2": (3, "--from-start", "still.npz lasts 2.0 s"),
        "--from-start 3": (2, "--from-start", "--from"),
        "--from kept --from-start -1": (2, "--from-start"),
        "--from still.npz --scenario noisy.toml": (2, "noise_level", "leave"),
        "--from still.npz --scenario moved.toml": (2, "gravity", "[instrument]", "accel_sign"),
        "--spoil errors.py": (2, "errors.py", "FILE.py:NAME"),
        "--spoil missing.py:a": (3, "missing.py", "no such file"),
        "--spoil errors.py:missing": (2, "errors.py", "missing", "five"),
        "--spoil errors.py:five": (3, "errors.py:five", "sample 0", "six"),
        "--spoil errors.py:infinite": (3, "errors.py:infinite", "sample 0", "finite"),
        "--spoil errors.py:failing": (3, "errors.py:failing", "sample 0", "line 13", "no such thing"),
        "--spoil errors.py:nothing": (3, "errors.py:nothing", "None"),
        "--spoil wrong.py:a": (3, "wrong.py", "SyntaxError", "line 1"),
        "--speed 0": (2, "--speed", "positive"),
        "--speed -1": (2, "--speed", "positive"),
        "--speed nan": (2, "not a finite number"),
        "--speed inf": (2, "not a finite number"),
        "--seed -1": (2, "--seed"),
        "--instrument imu999": (2, "imu999", "imu400cd, imu381"),
        "--from missing.raw": (3, "missing.raw"),
        "--from nothing.raw": (3, "nothing.raw", "S1"),
        "--from nothing.raw --instrument imu400cd": (2, "nothing.raw", "IMU381"),
        "--from nothing.raw --from-start 1": (2, "byte for byte", "--from-start"),
        "--from nothing.raw --scenario noisy.toml": (2, "byte for byte", "noisy.toml"),
        "--from nothing.raw --scenario biased.toml": (2, "byte for byte: leave biases, temperature out of biased.toml"),
        "--serial-number -1": (2, "--serial-number"),
        "--serial-number 4294967296": (2, "--serial-number"),
        "--tap kept": (2, "kept exists", "--force"),
    },
    "demo --headless --json": {
        "--seconds 0": (2, "duration"),
        "--seconds -2": (2, "duration"),
        "--seconds nan": (2, "not a finite number"),
        "--rate 500": (2, "133 Hz"),
        "--seed -1": (2, "seed"),
    },
    "campaign good.mcap -o out.mcap": {"--filter foo": (2, "not one of: spkf")},
    "export good.mcap --format csv --force": {
        "-o pipe": (2, "is a device or a pipe"),
        "-o /dev/null": (2, "is a device or a pipe"),
    },
}
"""How command lines begin and go on, with the exit code and what the error says: what would be right, or what to do."""


ERRORS = """def five(seed):
    return lambda t, temp, ang, rate, w, f: (0.0, 0.0, 0.0, 0.0, 0.0)


def infinite(seed):
    return lambda t, temp, ang, rate, w, f: (0.0, 0.0, 0.0, 0.0, 0.0, 1e999)


def failing(seed):
    def error(t, temp, ang, rate, w, f):
        if t >= 0.0:
            # as a writer's slip would
            raise KeyError("no such thing")

    return error


def nothing(seed):
    pass
"""


def spoilers(folder: Path) -> None:
    """Files of errors, of scenarios and a recording at rest that reads -1 g on Z."""
    (folder / "errors.py").write_text(ERRORS)
    (folder / "wrong.py").write_text("def a(:\n")
    t = np.arange(200) / 100.0
    np.savez(folder / "still.npz", t=t, gyro=np.zeros((200, 3)), accel=np.tile([0.0, 0.0, -1.0], (200, 1)))
    noisy = '[[effect]]\nname = "noise_level"\nchannel = "gx"\nlog_variance = 1.0\n'
    (folder / "noisy.toml").write_text(noisy)
    (folder / "biased.toml").write_text("[biases]\ngyro_dps = [1, 2, 3]\n[temperature]\nconstant_degc = 40\n")
    moved = '[[segment]]\nkind = "dwell"\nangles_deg = [90.0, 0.0, 0.0]\nseconds = 5.0\n'
    (folder / "moved.toml").write_text(moved)
    (folder / "nothing.raw").write_bytes(KEPT)


@pytest.fixture
def lab(home: Path, log: bytes) -> Path:
    """A folder with what the command lines name."""
    spoilers(home)
    for name, content in (
        ("good.npz", npz()),
        ("good.mcap", log),
        ("empty.mcap", b""),
        ("kept", KEPT),
        ("gremlins.toml", EFFECTS.encode()),
        ("newer.toml", b"version = 2\n"),
    ):
        (home / name).write_bytes(content)
    (home / "symbolic.mcap").symlink_to("good.mcap")
    (home / "hard.mcap").hardlink_to(home / "good.mcap")
    (home / "folder").mkdir()
    os.mkfifo(home / "pipe")
    return home


@pytest.mark.parametrize(("begins", "goes_on"), [(begins, end) for begins, ends in REFUSED.items() for end in ends])
def test_what_cannot_be_is_refused_with_what_would_be_right_and_changes_no_file(
    lab: Path, begins: str, goes_on: str
) -> None:
    """The exit code tells usage from data from disk from what is not there; a port that does not exist is not asked."""
    code, *words = REFUSED[begins][goes_on]
    before = {path: path.read_bytes() for path in lab.iterdir() if path.is_file()}
    said = error(run(*f"{begins} {goes_on}".split()), code)
    assert all(word in said for word in words), said
    assert before == {path: path.read_bytes() for path in lab.iterdir() if path.is_file()}
    assert (lab / "pipe").is_fifo()
    assert not (lab / "logs").exists()
