"""What is expected of an acquisition when something goes wrong around it, and what comes of it: a table row each.

    python benchmarks/reliability.py [--rows 1 4 9] [--quick]

Makes each thing happen to real processes on a virtual unit's pseudo-terminal, with the functions that
`tests/reliability` uses, but as often and as long as the expectation says; `--quick` once and shortly. All figures are
of the machine that it runs on, and of what else runs there. Long ones have scripts of their own: `soak.py`,
`acquisition.py jitter`, `fault_hour.py`, `foreign_readers.py`.
"""

import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bench
import numpy as np
from helpers.paths import SAMPLE
from reliability import clocks, endings, files, lines, ports, screens
from reliability.setting import acquiring


@dataclass(frozen=True, slots=True)
class Row:
    """One expectation."""

    number: int  # in the table
    # what, bar: what happens, and what is asked then
    what: str
    bar: str
    measure: Callable[[Path, bool], str]  # from an empty folder and whether it is to be quick, to the figures


def kill_nine(folder: Path, quick: bool) -> str:
    """At random moments after the start."""
    rng = np.random.default_rng(1)
    found = []
    for k in range(2 if quick else 20):
        place = folder / str(k)
        place.mkdir()
        found.append(endings.kill_nine(place, float(rng.uniform(1.0, 4.0))))
    assert all(set(one.read.values()) == {one.held} for one in found)
    lost = [one.lost_s for one in found]
    readers = ", ".join(found[0].read)
    return f"{len(found)} kills lost {min(lost):.2f} to {max(lost):.2f} s; recovered files read whole by {readers}"


def power_cut(folder: Path, quick: bool) -> str:
    """Calls counted, and a file cut at every byte."""
    synced = files.synced(folder, 10)
    cut = files.cuts(folder, 10 if quick else 1)
    return (
        f"{synced.data} fdatasync in {synced.flushes} flushes, {synced.folder} fsync of the folder;"
        f" {cut.wrong} of {cut.count} cuts misread"
    )


def signals(folder: Path, quick: bool) -> str:
    """In mid-flush, after a hang-up, in the foreground."""
    cases = {
        "SIGTERM": lambda place: endings.told_to_end(place, signal.SIGTERM, endings.in_a_flush),
        "SIGINT": lambda place: endings.told_to_end(place, signal.SIGINT, endings.in_a_flush),
        "SIGTERM after SIGHUP": lambda place: endings.told_to_end(place, signal.SIGTERM, endings.after_a_hangup),
        "Ctrl+C": endings.interrupted,
    }
    said = []
    for name, case in cases.items():
        ended = []
        for k in range(1 if quick else 5):
            place = folder / f"{name}{k}"
            place.mkdir()
            ended.append(case(place))
        file_s, gone_s = max(one.file_s for one in ended), max(one.gone_s for one in ended)
        said.append(f"{name}: file {file_s:.2f} s, process {gone_s:.2f} s, exit {ended[0].exit_code}")
    return "; ".join(said)


def link_dropped(folder: Path, quick: bool) -> str:
    """The screen's terminal goes away."""
    with acquiring(folder) as it:
        found = [screens.link_dropped(it, 1.0 if quick else 10.0) for _ in range(1 if quick else 5)]
    gone, share = max(one.gone_s for one in found), max(one.processor for one in found)
    return f"screen gone after {gone:.2f} s at most; acquisition {100 * share:.1f} % CPU; {found[-1].lost} packets lost"


def frozen(folder: Path, quick: bool) -> str:
    seconds = 3.0 if quick else 60.0
    with acquiring(folder) as it:
        return f"{seconds:.0f} s: {_lateness(screens.frozen(it, seconds))}"


def busy(folder: Path, quick: bool) -> str:
    """200×60 at 60 frames a second."""
    with acquiring(folder) as it:
        return _lateness(screens.busy(it, 3.0 if quick else 30.0))


def _lateness(found: screens.Lateness) -> str:
    return (
        f"{found.lost} of {found.packets} packets lost; stamps {found.median_ms:.2f} ms after the bytes (median),"
        f" {found.p99_ms:.2f} (p99), {found.max_ms:.1f} (max)"
    )


def unplugged(folder: Path, quick: bool) -> str:
    """Gone, another unit in its place, back under another name."""
    found = []
    for k in range(1 if quick else 5):
        place = folder / str(k)
        place.mkdir()
        found.append(lines.unplugged(place))
    noticed, back = max(one.noticed_s for one in found), max(one.back_s for one in found)
    return f"noticed after {noticed:.2f} s, back {back:.2f} s after its return; another serial number refused"


def noise(folder: Path, quick: bool) -> str:
    del folder
    found = lines.noise(1, 200 if quick else 20_000)
    return f"{found.faults} faults: {found.lost} good packets lost at one place at most, {found.invented} invented"


def silence(folder: Path, quick: bool) -> str:
    """No hang-up, no packets."""
    found = lines.silent(folder, 3.0 if quick else 8.0)
    return f"at 20 Hz told after {found.told_s:.1f} s, over {found.over_s:.1f} s after the first packet; at 0.1 Hz 30 s"


def disk_full(folder: Path, quick: bool) -> str:
    """A tmpfs of 200 KiB."""
    del quick
    if os.getuid() != 0:
        return "not measured: only root can mount a small disk"
    with files.small_disk(folder) as disk:
        found = files.disk_full(folder, disk)
    return f"exit {found.exit_code}; packets streamed {found.streamed}, by the index once recovered {found.recovered}"


def disk_guarded(folder: Path, quick: bool) -> str:
    """A tmpfs of 4 MB, of which others take all but 1.5."""
    del quick
    if os.getuid() != 0:
        return "not measured: only root can mount a small disk"
    found = files.guarded(folder)
    whole = "file whole" if found.finished else "FILE NOT WHOLE"
    again = "another start refused" if found.refused else "ANOTHER START NOT REFUSED"
    left = f"stopped after {found.stopped_s:.1f} s with {found.free_mb:.1f} MB free"
    return f"{left}, exit {found.exit_code}, {whole}; {again}"


def clock_set(folder: Path, quick: bool) -> str:
    del quick
    found = clocks.clock_set(folder, (3600.0, -3600.0))
    told = ", ".join(f"{step:+.1f}" for step in found.told_s)
    return (
        f"told: {told} s; log time back in {found.backwards} places; stamps {found.worst_step_ms:.3f} ms off the period"
    )


def ports_refused(folder: Path, quick: bool) -> str:
    del quick
    found = ports.refusals(folder)
    return "; ".join(f"{why}: exit {code}" for why, (code, _) in found.items()) + "; all different"


def held_alone(folder: Path, quick: bool) -> str:
    del folder, quick
    return "; ".join(f"{who}: {'refused' if refused else 'OPENS'}" for who, refused in ports.second_openings().items())


def overwriting(folder: Path, quick: bool) -> str:
    """A file that is there, names made up."""
    del quick
    found = files.overwritten(folder)
    kept = found.refused and found.unchanged
    return f"{'refused' if kept else 'OVERWRITTEN'}; two in one second: {', '.join(found.names)}"


def recorder_dies(folder: Path, quick: bool) -> str:
    times = []
    for k in range(1 if quick else 5):
        place = folder / str(k)
        place.mkdir()
        with acquiring(place) as it:
            times.append(screens.killed_under_the_screen(it))
    return f"told after {max(times):.2f} s at most, REC gone at once"


def changed(folder: Path, quick: bool) -> str:
    count = 20 if quick else 1000
    return f"{files.flipped(folder, count)} of {count} flipped bits not found by `check`"


def suspended(folder: Path, quick: bool) -> str:
    with acquiring(folder) as it:
        return f"{screens.suspended(it, 2.0 if quick else 20.0)} packets lost; screen put up anew"


def replayed(folder: Path, quick: bool) -> str:
    del folder
    speeds = (None, None, 1e6) if quick else (None, None, 1e6, 100.0, 20.0)
    return f"{clocks.replays_that_differ(SAMPLE, speeds)} of {len(speeds) - 1} differ, to the last bit"


ROWS = (
    Row(1, "kill -9 of the recorder", "1 s lost at most, three readers open it", kill_nine),
    Row(2, "power cut", "fdatasync each flush, a true beginning at any cut", power_cut),
    Row(3, "SIGTERM, SIGINT, SIGHUP", "finished within 2 s; SIGHUP ends nothing", signals),
    Row(4, "SSH drop under the screen", "screen gone within 1 s, recorder goes on below 2 % CPU", link_dropped),
    Row(5, "frozen terminal", "no sample lost, stamps unaffected", frozen),
    Row(6, "busiest screen", "p99 of receive stamps below 5 ms, no loss", busy),
    Row(7, "unplugged and plugged in again", "noticed within 1 s, back within 2 s, same unit only", unplugged),
    Row(8, "bit errors, junk, partial packets", "2 good packets a fault at most, nothing invented", noise),
    Row(9, "silence", "told after 3 periods, at least 1 s", silence),
    Row(10, "disk full", "exit 5, all up to the last flush, once", disk_full),
    Row(11, "disk guard", "refuses to start, stops above zero", disk_guarded),
    Row(12, "clock set by an hour", "an event; no stamp moves, log time never goes back", clock_set),
    Row(13, "port absent, busy, not permitted", "three messages with the remedy, exit 4", ports_refused),
    Row(14, "second program on the port", "refused, in both orders", held_alone),
    Row(15, "file that is there already", "never overwritten; names unique", overwriting),
    Row(17, "recorder dies under the screen", "shown within 1 s, never REC", recorder_dies),
    Row(18, "file changed afterwards", "found by `check`", changed),
    Row(19, "Ctrl+Z and fg", "no sample lost, screen restored", suspended),
    Row(20, "replay", "the same at any speed", replayed),
)


@contextmanager
def own_folder() -> Iterator[Path]:
    """An empty working folder, with sockets and configuration of its own."""
    before, environ = Path.cwd(), dict(os.environ)
    with tempfile.TemporaryDirectory(prefix="imutui-reliability-") as name:
        folder = Path(name)
        (folder / "run").mkdir(mode=0o700)
        os.environ |= {"XDG_RUNTIME_DIR": str(folder / "run"), "XDG_CONFIG_HOME": str(folder / "config")}
        os.chdir(folder)
        try:
            yield folder
        finally:
            os.chdir(before)
            os.environ.clear()
            os.environ.update(environ)


def main() -> None:
    asked = bench.options(__doc__, rows=list[int], quick=False)
    print(bench.describe("mcap", "rosbags", "textual", "pyserial"), flush=True)
    bench.head("#", "what happens", "asked", "measured")
    for row in ROWS:
        if asked.rows is None or row.number in asked.rows:
            began = time.monotonic()
            with own_folder() as folder:
                said = row.measure(folder, asked.quick)
            bench.row(row.number, row.what, row.bar, said)
            print(f"row {row.number}: {time.monotonic() - began:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
