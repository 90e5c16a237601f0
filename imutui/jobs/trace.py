"""From logs to what a unit's model lacks: read, check that they belong together, trace.

What it leaves out: the methods (`filters.tracing.trace`, `filters.multiposition`), how it is told (`imutui.report`),
files that come of it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

import imutui
from filters.channels import CHANNELS
from filters.effects import plain_names
from filters.errors import InputError
from filters.tracing.result import SeparatingExperiment, Trace
from filters.tracing.run import Run
from filters.tracing.trace_document import RunEntry, TraceDocument
from imutui.document_shape import VERSION
from imutui.jobs import channel_health, power_ons, residuals, run_consistency, runs
from imutui.jobs.quantities import utc_text
from imutui.jobs.runs import LoggedRun
from imutui.logbook import effects_file, power_on
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.reference_file import to_toml

Progress = Callable[[float, str], None]
_READING, _READING_LONG = 0.1, 0.9  # share of the time that it takes to read logs
_MOST_POINTS = 12


@dataclass(frozen=True, slots=True)
class _Wanted:
    """Arguments of `trace` that concern the tracing, not the reading."""

    about: tuple[str, ...]
    seed: int
    power_ons: tuple[int, ...]


def trace(
    logs: Sequence[Path],
    reading: Reading = AS_STATED,
    progress: Progress = lambda share, what: None,
    so_far: Callable[[str], None] = lambda text: None,
    *,
    holdout: Path | None = None,
    about: tuple[str, ...] = (),
    seed: int = 0,
    power_on_numbers: tuple[int, ...] = (),
) -> TraceDocument:
    """Trace a unit over its logs, one log a run or a part of one; return the document of contracts section 6.

    `reading`: what replaces the statements of the logs; its effects do not count.
    `progress`: called with the share done, 0 to 1, and what is being done.
    `so_far`: called with the result of the beginnings of long logs, before all of them is read.
    `holdout`: log of the run that nothing is fitted to; by default the last of several logs.
    `about`: effects whose limits are wanted even if nothing is found.
    `seed`: of everything random.
    `power_on_numbers`: number of each log's power-on, of logs that do not state what they continue.
    Raises UnreadableLogError if there is nothing to read in one of them.
    Raises InputError if they do not belong together, or do not follow their reference; the message says what to do.
    """
    _check_asked(about)
    training, heldout, notes = _divided(logs, holdout)
    paths = [*training, *([heldout] if heldout is not None else [])]
    names = _names(paths)
    wanted = _Wanted(about, seed, power_on_numbers)
    long = runs.is_long(paths)
    if long:
        progress(0.0, "tracing the beginning")
        so_far(_provisional(paths, names, reading, wanted, heldout))
    share_read = _READING_LONG if long else _READING
    reads = runs.read_runs(paths, names, reading, len(training), lambda share, what: progress(share_read * share, what))
    return _traced(
        reads, heldout, wanted, notes, lambda share, what: progress(share_read + (1.0 - share_read) * share, what)
    )


def read_together(logs: Sequence[Path], power_on_numbers: tuple[int, ...]) -> list[Run]:
    """Return the runs of logs of one unit, none held out; raises as `trace`."""
    reads = runs.read_runs(logs, _names(logs), Reading(), len(logs), lambda share, what: None)
    run_consistency.check_together(reads)
    for read in reads:
        run_consistency.check_reference(read)
    return [read.run for read in power_ons.join(reads, power_on_numbers)[0]]


def _provisional(
    paths: Sequence[Path],
    names: Sequence[str],
    reading: Reading,
    wanted: _Wanted,
    heldout: Path | None,
) -> str:
    """What the beginnings of long logs say; empty if they can't be traced by themselves."""
    try:
        reads = [runs.read_beginning(path, name, reading) for path, name in zip(paths, names, strict=True)]
        found = _traced(reads, heldout, wanted, [], lambda share, what: None)
    except InputError:
        return ""  # whether the whole can be traced is said when it is read
    minutes = sum(read.run.seconds for read in reads) / len(reads) / 60.0
    return f"Provisional, of the first {minutes:.0f} min: {found['sentence']}"


def _traced(
    reads: list[LoggedRun], heldout: Path | None, wanted: _Wanted, notes: list[str], progress: Progress
) -> TraceDocument:
    run_consistency.check_together(reads)
    by_hand = _is_turned(reads)
    for read in () if by_hand else reads:
        run_consistency.check_reference(read)
    reads, joined = power_ons.join(reads, wanted.power_ons)
    fitted, held = (reads, None) if heldout is None else (reads[:-1], reads[-1])
    notes = notes + joined
    notes += [f"{read.run.name}: {read.how}" for read in reads if read.how]
    lacking = {read.run.name: ", ".join(CHANNELS[c] for c in read.run.unread) for read in reads if read.run.unread}
    notes += [f"{name} has no readings of {channels}: left out" for name, channels in lacking.items()]
    found, own_notes = _found(fitted, held, wanted, progress, by_hand=by_hand)
    notes += own_notes
    if by_hand and not all(read.info.site_stated for read in reads):
        notes.append(_SITE_NOT_STATED)
    entries = [_run(read, heldout=read is held) for read in reads]
    notes += [f"{entry['id']}: {fault['said']}" for entry in entries for fault in entry["health"]]
    source = _source(fitted, held)
    units = dict.fromkeys(unit for read in reads if (unit := effects_file.unit_of(read.info)))
    own: Any = found.document
    first = (
        "untestable", "integrity", "lines", "noise_level", "findings", "refuted", "common", "weak", "drift",
        "remainder", "status",
    )  # fmt: skip
    document = {  # in the order of docs/formats.md
        "version": VERSION,
        "runs": entries,
        **{key: own[key] for key in first},
        "separating_experiment": None if found.experiment is None else _experiment(found.experiment),
        **{key: own[key] for key in ("error", "limits", "carries_over", "seed", "sentence")},
        "notes": notes,
        "library": f"imutui {imutui.__version__}",
        "diary": None,
        "source": source,
        "damage": [sentence for read in reads if (sentence := _damage(read))],
        "effects_file": effects_file.dumps(found, source, tuple(units)),
        "curves": residuals.curves(found.series, None if held is None else held.run.name),
    }
    return cast("TraceDocument", _plain(document))


def _found(
    fitted: Sequence[LoggedRun], held: LoggedRun | None, wanted: _Wanted, progress: Progress, *, by_hand: bool
) -> tuple[Trace, list[str]]:
    """Trace logs, of a unit turned by hand from readings alone; return notes on what they can be expected to show."""
    training, heldout = [read.run for read in fitted], None if held is None else held.run
    if by_hand:
        # these bring solvers along, which other traces need not wait for
        from filters.multiposition.calibration import calibrate
        from filters.multiposition.report import notes, report

        calibration = calibrate(training, heldout, wanted.seed, progress)
        return report(calibration, wanted.about, wanted.seed), notes(calibration)
    from filters.tracing.trace import trace as trace_runs

    expected = run_consistency.expectations(fitted, held)
    found = trace_runs(training, heldout, asked=wanted.about, seed=wanted.seed, progress=progress)
    return found, expected + _not_in_the_file(found)


def _not_in_the_file(found: Trace) -> list[str]:
    """Findings that hold, and that the filter cannot have."""
    has = {(effect.effect, effect.channels) for effect in found.included}
    return [
        f"{', '.join(f['channels'])}: {plain_names.named(f['label'], f['effect'])} is not in the effects file: the"
        " filter does not keep what it depends on, the past of the motion or a temperature that was crossed"
        for f in found.document["findings"]
        if f["include_as"] == "A" and f["confirmed"] is not False and (f["effect"], tuple(f["channels"])) not in has
    ]


def _experiment(experiment: SeparatingExperiment) -> dict[str, Any]:
    """The run to make next, its profile as the text of a file."""
    return {**asdict(experiment), "profile": to_toml(experiment.profile, _what_it_is_for(experiment))}


def _what_it_is_for(experiment: SeparatingExperiment) -> list[str]:
    """What the file of the run says to whoever makes it: what for, and what to do besides moving the table."""
    a, b = (plain_names.effect(effect) for effect in (experiment.a, experiment.b))
    thermal = [f"{degc:g} degC at {t:g} s" for t, degc in experiment.thermal or ()]
    motion = experiment.motion[:1].upper() + experiment.motion[1:]
    told = [f"{a[:1].upper()}{a[1:]}, or {b}? {motion}."]
    if 2 < len(thermal) <= _MOST_POINTS:
        told.append(f"Temperature in the case: {', '.join(thermal)}.")
    return told


def _check_asked(effects: Sequence[str]) -> None:
    from filters.effects.catalogue import EFFECTS

    for effect in effects:
        if effect not in EFFECTS:
            raise InputError(f"{effect!r} is no effect of the catalogue; it has: {', '.join(EFFECTS)}")


def _divided(logs: Sequence[Path], holdout: Path | None) -> tuple[list[Path], Path | None, list[str]]:
    """Logs to fit, the log held out, and what was done about one that is both."""
    if holdout is None:
        return (list(logs), None, []) if len(logs) == 1 else (list(logs[:-1]), logs[-1], [])
    kept = [log for log in logs if not _same_file(log, holdout)]
    if not kept:
        raise InputError(
            f"{holdout} is held out, and there is no other log to trace. Name more logs, or leave --holdout out: one"
            " log is judged by folds within it."
        )
    told = [] if len(kept) == len(logs) else [f"{holdout} is held out: it is not among the logs that are fitted"]
    return kept, holdout, told


def _same_file(a: Path, b: Path) -> bool:
    return a == b or (a.exists() and b.exists() and a.samefile(b))


def _plain(value: Any) -> Any:
    """A value as JSON has it: what is not finite is nothing."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _names(paths: Sequence[Path]) -> list[str]:
    """Short names, no two alike."""
    for name in (lambda path: path.stem, str):
        names = [name(path) for path in paths]
        if len(set(names)) == len(names):
            return names
    # the same log twice: refused when their samples are compared
    return [f"{n} {path.stem}" for n, path in enumerate(paths, 1)]


def _run(read: LoggedRun, *, heldout: bool) -> RunEntry:
    run, info = read.run, read.info
    return {
        "id": run.name,
        "log": str(read.path.resolve()),
        "kind": info.kind,
        "source": info.source,
        "rate_hz": run.rate_hz if run.full_rate is None else run.full_rate.rate_hz,
        "seconds": run.seconds,
        "samples": int(run.t.size) if run.full_rate is None else run.full_rate.samples,
        "accel_sign": info.accel_sign,
        "mount": info.mount,
        "reference": info.reference,
        "heldout": heldout,
        "power_on": power_on.power_on_id(info, read.sha256),
        "begins_s": run.begins,
        "history_known": run.history_known,
        "log_sha256": read.sha256,
        "identity": info.identity(),
        "assumed": list(read.log.assumed),
        "health": channel_health.of_log(read.path, info, read.reading).entries(moving=False),
        # the stamps of an import begin when its file was last written
        "start_utc": "" if info.sampling == "imported" else utc_text(read.log.first_ns),
        "temperature_degc": None if run.temperature is None else [run.temperature.min(), run.temperature.max()],
    }


def _damage(read: LoggedRun) -> str:
    if read.log.damage:
        return f"{read.path}: {read.log.damage}. Read up to {read.run.seconds:.1f} s; all before that is used."
    return "" if read.log.finished else f"{read.path} is unfinished; all up to its last flush is used."


def _source(fitted: Sequence[LoggedRun], held: LoggedRun | None) -> str:
    text = "trace of " + ", ".join(read.path.name for read in fitted)
    return text if held is None else f"{text}; held out {held.path.name}"


# ------------------------------------------------------------------------------------------------------------- turned

_TURNED = "turned"
_SITE_NOT_STATED = (
    "the site is not stated: gravity is that of the default place, which may be off by 0.26 % (1 sd). Scale factors of"
    " accelerometers are relative to it, and so is the size of gravity; ratios of the three, their misalignments and"
    " biases are not affected. State it: --site LAT,LON,H where you record or import"
)


def _is_turned(reads: Sequence[LoggedRun]) -> bool:
    """Whether logs are of a unit turned by hand.

    Raises InputError if some are and some are not.
    """
    turned = [read for read in reads if read.info.reference == _TURNED]
    others = [read for read in reads if read.info.reference != _TURNED]
    if turned and others:
        raise InputError(
            f"{turned[0].path} was turned by hand (reference turned) and {others[0].path} was not (reference"
            f" {others[0].info.reference}): their errors are of different kinds. Trace them apart; effects of the one"
            " can be given to the filter on the other (-o FILE, imutui replay --effects FILE)."
        )
    return bool(turned)
