"""Rules of `check` on times, and on what the unit sent: gaps, rate, losses, counter, samples, limits."""

from collections.abc import Callable, Iterator

import numpy as np

from filters.imu import CHANNELS, LOOP_HZ
from filters.kalman.settings import GAP_PERIODS
from imutui.instrument.scaling import Scaling
from imutui.jobs import damage_text
from imutui.jobs.check_context import CheckContext, Finding
from imutui.jobs.quantities import plural, that_many
from imutui.logbook import line_advice, polled_rate, schemas, unread_channels

_RATE_OFF = 0.02
_STAMP_SLACK_NS = 20_000_000
_EARLIEST_NS = 946_684_800_000_000_000  # 2000: before that it is no UTC but some other clock
_LIMITS = (-32768, 32767)
_EVERY_HZ = 133.0
_FEW, _SHARE = 2, 0.1
_SURELY_MORE = 1.7


def _times(log: CheckContext) -> Iterator[Finding]:
    """Rules of time that a log is written by: UTC, never backwards, no jump against the monotonic clock."""
    for topic, heads in log.audit.messages.items():
        stamps = heads["log_ns"]
        if stamps[0] < _EARLIEST_NS:
            what = f"{topic}: the log time is not UTC: it begins before the year 2000."
            yield Finding("log_time", what, "from the first message on", _CLOCK)
        back = np.flatnonzero(np.diff(stamps) < 0)
        if back.size:
            what = f"{topic}: log time goes back in {plural(int(back.size), 'place')}."
            yield Finding("log_time", what, f"first {log.at(int(stamps[back[0]]))}", _CLOCK)
    yield from _sample_times(log)
    if log.raw is not None and log.raw.size:
        offset = log.raw["log_ns"] - log.audit.packets["host_monotonic_ns"]
        steps = np.flatnonzero(np.diff(offset))
        if steps.size and log.audit.session:
            k = int(steps[0])
            what = (
                f"Log time jumps by {(int(offset[k + 1]) - int(offset[k])) / 1e9:+.6f} s against the monotonic clock."
            )
            yield Finding("log_time", what, log.at(int(log.raw["log_ns"][k + 1])), _CLOCK)


_CLOCK = "The times are not to be trusted there; replay a part without it (--start, --end)."


def _sample_times(log: CheckContext) -> Iterator[Finding]:
    """Stamps of the samples: in order, finite, and those of their messages."""
    a = log.audit
    back = np.flatnonzero(np.diff(a.samples) <= 0)
    if back.size:
        what = f"Sample time does not increase in {plural(int(back.size), 'place')}; a replay refuses the log."
        yield Finding("stamps", what, f"first {log.at(int(a.samples[back[0]]))}", log.recover())
    lacks = unread_channels.unread(a.gyro, a.accel) & (a.samples.size > 0)
    bad = np.flatnonzero(~(np.isfinite(np.hstack([a.gyro, a.accel])) | (lacks & ~lacks.all())).all(axis=1))
    if bad.size:
        what = f"{that_many(int(bad.size), 'sample', 'is no number', 'are not numbers')}; a replay refuses the log."
        where = f"first {log.at(int(a.samples[bad[0]]))}"
        yield Finding("stamps", what, where, "Remove them in the program that wrote the file.")
    heads = a.messages.get(a.imu_topic or "")
    if heads is None or not a.session or heads.size != a.samples.size:
        return
    if (heads["publish_ns"] != a.samples).any():
        k = int(np.argmax(heads["publish_ns"] != a.samples))
        what = "A sample's stamp is not its message's publish time."
        yield Finding("stamps", what, f"first {log.at(int(a.samples[k]))}", _CLOCK)
    early = heads["publish_ns"] - heads["log_ns"] > _STAMP_SLACK_NS
    if early.any():
        n = int(early.sum())
        what = f"{that_many(n, 'sample', 'is', 'are')} stamped later than received."
        yield Finding("stamps", what, f"first {log.at(int(a.samples[int(np.argmax(early))]))}", _CLOCK)


def _gaps(log: CheckContext) -> Iterator[Finding]:
    """Gaps between samples, and the rate."""
    if log.t.size < 3:
        return
    steps = np.diff(log.t)
    info = log.audit.info
    period = 1.0 / info.rate_hz if info is not None else float(np.median(steps))
    long = np.flatnonzero(steps > GAP_PERIODS * period)
    # bursts of a host's stamps are no gaps in the samples
    if (long.size and long.size <= max(1.0, 0.001 * steps.size)) or (
        long.size and info is not None and log.raw is not None
    ):
        longest = int(long[np.argmax(steps[long])])
        what = f"{plural(int(long.size), 'gap')} between samples, the longest {steps[longest]:.3f} s."
        where = f"first at {log.t[long[0]]:.3f} s, longest at {log.t[longest]:.3f} s"
        yield Finding("gaps", what, where, "The filter predicts through 2 s at most; trace leaves gaps out.")
    if info is None or info.sampling == "imported":
        return
    if log.polled:
        yield from _polled_rate(log, info.rate_hz)
        return
    measured = (log.t.size - 1) / log.t[-1]
    if not long.size and abs(measured / min(info.rate_hz, LOOP_HZ) - 1.0) > _RATE_OFF:
        what = f"{info.rate_hz:g} Hz were asked for, {measured:.3f} Hz came."
        yield Finding("rate", what, "over the whole log", "Ask for a rate that the unit and its line speed can give.")


def _polled_rate(log: CheckContext, rate_hz: float) -> Iterator[Finding]:
    """Whether so many packets a second were asked for as should be, while the unit answered."""
    steps = np.diff(log.t)
    short = steps[steps <= polled_rate.usual_step_s(rate_hz)]
    if short.size < (1.0 - polled_rate.RARE) * steps.size:
        short = steps[steps <= polled_rate.longest_step_s(rate_hz)]
    # what was lost is no request too few, but for that in the long steps, one at the least in each
    requests = short.size + max(0, _integer(log.audit.diagnostics.get("lost_packets")) - (steps.size - short.size))
    slow = polled_rate.finding(rate_hz, requests / float(short.sum())) if short.size >= polled_rate.FEWEST else None
    if slow is not None:
        what, _, cure = slow.partition(". ")
        yield Finding("rate", f"{what}.", "over the whole log", cure)


def _line(log: CheckContext) -> Iterator[Finding]:
    """What was lost on the line, by the recorder's count and by the packets themselves."""
    told = {key: _integer(log.audit.diagnostics.get(key)) for key in ("lost_packets", "bad_checksums")}
    certain = told["lost_packets"]
    # logs of before had no bounds
    most = max(certain, _integer(log.audit.diagnostics.get("lost_packets_max")))
    lost, where = _lost_packets(log)
    if lost or most:
        what = _how_many(certain, most) if most else f"{that_many(lost, 'packet', 'was', 'were')} lost on the line."
        slack = max(_FEW, _SHARE * most)
        differ = not certain - slack <= lost <= most + slack
        if log.raw is not None and not log.polled and differ and not damage_text.lossy(log.found):
            what = (
                f"{_how_many(certain, most)[:-1]} by the recorder's count, {lost:,} by the times of those that are"
                " there."
            )
        yield Finding("lost", what, where, _where_to_look(log, held_up=_held_up(log)))
    if told["bad_checksums"]:
        what = f"{that_many(told['bad_checksums'], 'packet', 'was', 'were')} dropped: the checksum was wrong."
        yield Finding("checksums", what, "by the recorder's count", _where_to_look(log))


def _how_many(certain: int, most: int) -> str:
    if certain == most:
        return f"{that_many(certain, 'packet', 'was', 'were')} lost on the line."
    return f"Between {certain:,} and {most:,} packets were lost: while the line was silent the unit may have sent some."


def _where_to_look(log: CheckContext, *, held_up: bool = False) -> str:
    info = log.audit.info
    port, firmware = (info.port, info.firmware) if info is not None else ("", "")
    return line_advice.of_losses(port, firmware, held_up=held_up)


def _held_up(log: CheckContext) -> bool:
    """Whether most losses follow at once on packets that were read late."""
    if log.raw is None or not log.raw.size:
        return False
    read = log.raw["log_ns"]
    late = read - log.raw["publish_ns"] > line_advice.HELD_UP_S * 1e9
    last_late = np.maximum.accumulate(np.where(late, read, np.iinfo(np.int64).min // 2))
    lost = (log.audit.packets["flags"] & schemas.FLAG_LOST_BEFORE) > 0
    return bool(lost.any()) and bool(np.mean((read - last_late)[lost] < line_advice.NEAR_S * 1e9) > 0.5)


def _lost_packets(log: CheckContext) -> tuple[int, str]:
    """Packets missing between those of a stream by the times of those that are there, and where first."""
    if log.raw is None or log.raw.size < 3 or log.polled:
        return 0, "by the recorder's count"
    steps = np.diff(log.raw["publish_ns"].astype(np.float64))
    period = _mean_step(steps)
    # what the file itself lost is told by the messages' numbers
    inside = np.diff(log.raw["sequence"].astype(np.int64)) == 1
    flagged = (log.audit.packets["flags"][1:] & schemas.FLAG_LOST_BEFORE) > 0
    # a line that sets the pace makes steps of one and of two periods of the unit's loop; and a recorder that bounds
    # its losses flags them all, while its first stamps may still move
    surely = _SURELY_MORE if "lost_packets_max" not in log.audit.diagnostics else 2.0 * _SURELY_MORE
    periods = np.rint(steps / max(period, 1.0))
    missing = np.where(inside & (flagged | (steps > surely * period)), periods - 1.0, 0.0)
    places = np.flatnonzero(missing > 0)
    if not places.size:
        return 0, "by the recorder's count"
    first = log.at(int(log.raw["publish_ns"][places[0]]))
    return int(missing.sum()), f"in {plural(int(places.size), 'place')}, first {first}"


def _mean_step(steps: np.ndarray) -> float:
    """Mean step from packet to packet where none is missing."""
    return float(steps[steps < _SURELY_MORE * np.median(steps)].mean())


def _counter(log: CheckContext) -> Iterator[Finding]:
    """Whether the unit's time counter goes on evenly, and the packets' own numbers."""
    p = log.audit.packets
    if log.raw is None or p.size < 3 or log.polled:
        return
    steps = np.diff(log.raw["publish_ns"].astype(np.float64))
    ticks = np.mod(-np.diff(p["ticks"].astype(np.int64)), 65536)
    usual_step = _mean_step(steps)
    contiguous = (np.diff(log.raw["sequence"].astype(np.int64)) == 1) & (steps < 1.5 * usual_step)
    contiguous &= (p["flags"][1:] & (schemas.FLAG_LOST_BEFORE | schemas.FLAG_HOST_STAMP)) == 0
    if contiguous.sum() < 3:
        return
    usual = float(np.median(ticks[contiguous]))
    off = np.flatnonzero(contiguous & (np.abs(ticks - usual) > 0.6 * usual))
    if off.size:
        what = f"The unit's time counter jumps in {plural(int(off.size), 'place')} without a packet missing."
        where = f"first {log.at(int(log.raw['publish_ns'][off[0] + 1]))}"
        yield Finding("counter", what, where, "Check the unit's supply: it may have begun anew.")


def _samples_of_packets(log: CheckContext) -> Iterator[Finding]:
    """Whether each sample is what its packets say: how many, when, which values."""
    a, info = log.audit, log.audit.info
    if log.raw is None or info is None or info.sampling not in ("stream", "polled") or not log.raw.size:
        return
    if (np.diff(log.raw["sequence"].astype(np.int64)) != 1).any() or int(log.raw["sequence"][0]) != 0:
        return  # a group that lost a packet in the file can't be made again
    stamps, counts = _grouped(log, each=log.polled or info.rate_hz >= _EVERY_HZ)
    n = min(stamps.size, a.samples.size)
    if abs(stamps.size - a.samples.size) > (1 if log.found.cut else 0):
        what = f"The packets make {plural(int(stamps.size), 'sample')}, the log has {a.samples.size:,}."
        yield Finding("samples", what, "over the whole log", log.recover())
    axes, scaling = info.axes(), Scaling(info.rate_range_dps, info.accel_range_g)
    gyro = axes.gyro_to_body(np.deg2rad(scaling.rates_dps(counts[:n, :3])))
    accel = axes.accel_to_body(scaling.accels_g(counts[:n, 3:]) * info.g_unit)
    same = stamps[:n] == a.samples[:n]
    same &= np.isclose(gyro, a.gyro[:n], rtol=1e-9, atol=1e-9).all(axis=1)
    same &= np.isclose(accel, a.accel[:n], rtol=1e-9, atol=1e-9).all(axis=1)
    if not same.all():
        k, off = int(np.argmin(same)), int(n - same.sum())
        what = f"{that_many(off, 'sample', 'is not what its', 'are not what their')} packets say."
        yield Finding("samples", what, f"first {log.at(int(a.samples[k]))}", "Trust the packets; write to us.")


def _grouped(log: CheckContext, *, each: bool) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (ns) and mean counts of the samples that the packets make, as the recorder groups them."""
    assert log.raw is not None
    assert log.audit.info is not None
    stamps, counts = log.raw["publish_ns"], log.audit.packets["counts"].astype(np.float64)
    if each:
        return stamps, counts
    since = stamps - stamps[0]
    number = np.maximum.accumulate((since / (1e9 / log.audit.info.rate_hz)).astype(np.int64))
    edges = np.flatnonzero(np.diff(number, prepend=-1))
    sizes = np.diff(np.append(edges, number.size))
    first = stamps[edges]
    late = np.add.reduceat(stamps - np.repeat(first, sizes), edges)
    mean = np.add.reduceat(counts, edges, axis=0) / sizes[:, None]
    # the last period's sample would have come with the first packet after it
    return (first + np.rint(late / sizes).astype(np.int64))[:-1], mean[:-1]


def _limits(log: CheckContext) -> Iterator[Finding]:
    """Readings that stand at the end of their range."""
    counts = log.audit.packets["counts"]
    at_limit = np.isin(counts, _LIMITS)
    if at_limit.any():
        rows = np.flatnonzero(at_limit.any(axis=1))
        channels = [name for name, hit in zip(CHANNELS, np.any(at_limit, axis=0).tolist(), strict=True) if hit]
        what = f"{that_many(int(rows.size), 'packet', 'has', 'have')} a count at its limit ({' '.join(channels)})."
        first = log.at(int(log.raw["publish_ns"][rows[0]])) if log.raw is not None else ""
        yield Finding("limits", what, f"first {first}", "The filter leaves them out. Turn the table more slowly there.")
    elif not log.audit.valid.all():
        rows = np.flatnonzero(~log.audit.valid)
        what = f"{that_many(int(rows.size), 'sample', 'is', 'are')} flagged as no reading."
        yield Finding("limits", what, f"first at {log.t[rows[0]]:.3f} s", "The filter leaves them out.")


def _integer(text: str | None) -> int:
    try:
        return int(text) if text else 0
    except ValueError:
        return 0


RULES: tuple[Callable[[CheckContext], Iterator[Finding]], ...] = (
    _times,
    _gaps,
    _line,
    _counter,
    _samples_of_packets,
    _limits,
)
