"""The metadata of an acquisition's logs, their names, and the recording before the first of them.

After a crash, or when the computer was started anew, an acquisition goes on in a new file. Its metadata name the file
before and its end. They do not state that both are of one power-on, since the unit may have lost its power meanwhile
(`imutui.logbook.power_on` is for what is known).
"""

import contextlib
import hashlib
import os
import pwd
import re
import socket
import stat
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import imutui
from filters.errors import InputError
from filters.kalman.augmentation import MakeEffects
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.command_line import command
from imutui.instrument.driver import Identity
from imutui.instrument.port import Port
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import log_time, reference_file, summary
from imutui.logbook.session_info import FROM_LOG, MEASURED, SIMULATED, UNKNOWN, SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.plain_text import in_line
from imutui.session.plan import FilterChanges, Plan, batch_of
from imutui.settings import LoggedSettings, settings_of

PROCESS, COMPUTER = "process", "computer"  # what was started anew since the recording before
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_LOOKED_AT = 100
_SAME = ("acquisition", "serial_number", "host")
STAMPS = (
    "log_time: UTC at start plus monotonic clock, when the last byte was read. publish_time, header.stamp: sampling"
    " instant, from the time counter fitted to arrival less the packet's time on the line (stream), or arrival less"
    " that time (polled); never later than the arrival; how far off they may be is in /diagnostics."
    " Of averaged samples: the mean of their packets' instants."
)


def requested(plan: Plan) -> SessionInfo:
    """Return the metadata that the plan states; what is only found with the unit has its default."""
    stated = {each.name: getattr(plan, each.name) for each in settings_of(LoggedSettings).values()}
    stated |= {"note": plan.note, "controller": plan.controller}
    return SessionInfo(**{name: value for name, value in stated.items() if value is not None})


def session_info(plan: Plan, port: Port, identity: Identity, controller_identity: str = "") -> SessionInfo:
    """Return the metadata of an acquisition; `controller_identity` is of a table under command."""
    version = identity.version.upper()
    # a virtual instrument says so in its version; nothing simulated may pass for measured
    kind = SIMULATED if "VIRTUAL SIM" in version else UNKNOWN if "VIRTUAL" in version else MEASURED
    info = replace(
        requested(plan),
        instrument=_model(plan, identity),
        serial_number=identity.serial_number,
        firmware=identity.version,
        configuration=identity.configuration,
        own_mount=identity.own_mount,
        kind=kind,
        port=plan.port if "://" in plan.port else port.name,
        baud=port.baud,
        host=socket.gethostname(),
        acquisition=plan.name,
        batch=batch_of(plan.name),
        boot_id=boot_id(),
        operator=plan.operator or user_name(os.getuid()),
        software=f"imutui {imutui.__version__}, numpy {np.__version__}",
        stamps=STAMPS,
        source=identity.source,
        controller_identity=controller_identity,
    )
    return _filtering(plan, info.placed(plan.site, plan.gravity))


def _model(plan: Plan, identity: Identity) -> str:
    instrument = INSTRUMENTS[plan.instrument]
    return instrument.model if instrument.is_one_model else identity.model or instrument.model


def _filtering(plan: Plan, info: SessionInfo) -> SessionInfo:
    """Return metadata with the filter of the plan and its input."""
    name, text = plan.reference_file
    effects = ""
    if plan.effects:
        from imutui.logbook import effects_file

        effects = effects_file.digest(plan.effects.encode())
    return replace(
        info,
        filter=filter_of(plan, motion_of(plan)),
        reference=plan.reference,
        reference_sha256=hashlib.sha256(text.encode()).hexdigest() if name else "",
        effects_sha256=effects,
    )


_CSV = (reference_file.ATTACHMENTS[1], "text/csv")
_WITHOUT_FILE = ("level", "gravity", "turned")


def reconfigured(plan: Plan, info: SessionInfo, changes: FilterChanges) -> tuple[Plan, SessionInfo]:
    """Return plan and metadata with another reference or other effects; raises InputError if one cannot be used.

    A reference without a file replaces the present file. A file determines which kind of reference it is.
    """
    if "reference_file" in changes or changes.get("reference") in _WITHOUT_FILE:
        name, text = changes.get("reference_file", ("", ""))
        kind = changes.get("reference", "level")
        if name:
            is_profile = isinstance(reference_file.parse(name, text.encode()), Profile)
            kind = "profile" if is_profile else "trajectory"
        plan = replace(plan, reference=kind, reference_file=(name, text))
    elif "reference" in changes:
        plan = replace(plan, reference=changes["reference"])
    if "effects" in changes:
        plan = replace(plan, effects=changes["effects"])
        if plan.effects and plan.filter != "spkf":
            raise InputError(
                f'effects join the filter "spkf" only, and this acquisition runs "{plan.filter}". Connect again with'
                " the filter spkf, or replay the recording with --effects"
            )
    return plan, _filtering(plan, info)


def motion_of(plan: Plan) -> Profile | Trajectory | None:
    """Return the motion in the file that the reference comes from; None if it comes from none."""
    name, text = plan.reference_file
    return reference_file.parse(name, text.encode()) if name else None


def filter_of(plan: Plan, motion: Profile | Trajectory | None) -> str:
    """Return the filter that runs live; "none" with a profile that can only be aligned to a whole log."""
    return "none" if isinstance(motion, Profile) and motion.align == "gyro" else plan.filter


def effects_of(plan: Plan, info: SessionInfo) -> MakeEffects | None:
    """Return the function that makes the effects of the plan's effects file; None if it has none."""
    if not plan.effects:
        return None
    # loads the effects, and with them the signal library
    from imutui.logbook import effects_file

    return effects_file.maker(plan.effects.encode(), info)


def check_live(info: SessionInfo, motion: Profile | Trajectory | None, effects: MakeEffects | None = None) -> None:
    """Raise InputError for settings that a filter cannot use live, before the instrument is touched."""
    if info.noise == FROM_LOG:
        raise InputError(
            '`noise` is "log": it is measured on a whole log, so it cannot be used live. Record, then replay with'
            " --set filter.noise=log."
        )
    settings = info.settings(motion, effects=effects)
    if info.filter == "none":
        return
    if settings.reference not in ("level", "gravity") or effects is not None:
        # loads the filter; a reference without a file need not wait for it, since nothing of it can be refused
        from filters.kalman.runner import Estimator

        Estimator(settings)


def attach(writer: LogWriter, plan: Plan, now_ns: int) -> None:
    """Attach a plan's reference and effects files to a log, under the names that a replay looks for."""
    name, text = plan.reference_file
    if name:
        toml = name.lower().endswith(".toml")
        attachment, media_type = (reference_file.ATTACHMENTS[0], "application/toml") if toml else _CSV
        writer.attach(attachment, media_type, text.encode(), now_ns)
    if plan.effects:
        from imutui.logbook import effects_file

        writer.attach(effects_file.ATTACHMENT, effects_file.MEDIA_TYPE, plan.effects.encode(), now_ns)


@lru_cache(maxsize=1)
def effect_labels(text: str) -> tuple[str, ...]:
    """Return channels and name of each effect in the text of an effects file."""
    if not text:
        return ()
    from imutui.logbook import effects_file

    return tuple(f"{'/'.join(effect.channels)} {effect.effect}" for effect in effects_file.parse(text.encode()).effects)


def default_path(logs: Path, instrument: str, serial_number: str, note: str) -> Path:
    """Return a path that does not exist yet, named after kind of unit, serial number, UTC and note."""
    slug = re.sub(r"[^A-Za-z0-9]+", "-", note).strip("-").lower()[:40]
    utc = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(log_time.now_ns() // 1_000_000_000))
    stem = "_".join(part for part in (instrument, serial_number, utc, slug) if part)
    path, number = logs / f"{stem}.mcap", 2
    while path.exists():
        path, number = logs / f"{stem}_{number}.mcap", number + 1
    return path


def boot_id() -> str:
    """Return the id of this run of the computer, from power-up to power-down; "" if unknown."""
    try:
        return _BOOT_ID.read_text().strip()
    except OSError:
        return ""


def previous_log(folder: Path, info: SessionInfo, *, finished_too: bool) -> summary.Summary | None:
    """Return the last recording in a folder of the same acquisition, unit and computer as the one that begins.

    None if there is none, or if it was finished, unless `finished_too`.
    """
    for path in _newest(folder):
        try:
            found = summary.read(path)
        except OSError:  # removed meanwhile, or not for this user
            continue
        is_same = all(found.session.get(key) == getattr(info, key) for key in _SAME)
        if is_same and found.state not in (summary.NO_LOG, summary.WRITING):
            return found if finished_too or found.state != summary.FINISHED else None
    return None


def naming(info: SessionInfo, previous: summary.Summary | None) -> SessionInfo:
    """Return metadata that name the recording before, or that none is known."""
    if previous is None:
        return replace(info, previous="", previous_id="", previous_end="", restart="")
    booted = previous.session.get("boot_id", "")
    return replace(
        info,
        previous=previous.path.name,
        previous_id=previous.session.get("log_id", ""),
        # a file that is damaged has no summary
        previous_end=summary.FINISHED if previous.state == summary.FINISHED else summary.UNFINISHED,
        restart="" if not (booted and info.boot_id) else PROCESS if booted == info.boot_id else COMPUTER,
    )


def continuation(info: SessionInfo, previous: summary.Summary) -> str:
    """Return the text of the event in a file whose metadata name the recording before."""
    is_finished = info.previous_end == summary.FINISHED
    why = {PROCESS: "" if is_finished else "a crash", COMPUTER: "a restart of the computer", "": ""}[info.restart]
    last_s = previous.modified if previous.started_ns is None else previous.started_ns / 1e9 + (previous.seconds or 0.0)
    when = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(last_s))
    how = "was finished" if is_finished else "ended unfinished"
    said = f"continues after {why or 'an earlier recording'}: {in_line(info.previous)} {how} at {when}."
    path = previous.path
    whole = path.with_name(f"{path.stem}_recovered{path.suffix}")
    cure = "" if is_finished else f"; `{command('recover', path, '-o', whole)}` makes it whole"
    return f"{said} Whether the unit kept its power is not known{cure}"


def _newest(folder: Path) -> Iterator[Path]:
    """Yield the newest logs of a folder, the last one first: a folder of thousands would hold up the recording."""
    stamped = list[tuple[int, Path]]()
    with contextlib.suppress(OSError):  # a share that went away; the recorder will say so
        for path in folder.glob("*.mcap"):
            with contextlib.suppress(OSError):  # a link that leads nowhere, or a file that was removed
                status = path.stat()
                # a pipe of that name would be waited for
                stamped += [(status.st_mtime_ns, path)] if stat.S_ISREG(status.st_mode) else []
    return (path for _, path in sorted(stamped, reverse=True)[:_LOOKED_AT])


def user_name(uid: int) -> str:
    """Return the name of a user, or the id of one without a name."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)
