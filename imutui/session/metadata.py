"""What is known of an acquisition when it begins: the metadata of its logs, and their names."""

import getpass
import hashlib
import os
import re
import socket
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import imutui
from filters.errors import InputError
from filters.kalman.augmentation import MakeEffects
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.instrument.driver import Identity
from imutui.instrument.port import Port
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import log_time, reference_file
from imutui.logbook.session_info import FROM_LOG, MEASURED, SIMULATED, UNKNOWN, SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session.identity import model_of
from imutui.session.plan import Plan, batch_of
from imutui.session.previous_log import boot_id
from imutui.session.requests import FilterChanges
from imutui.settings import LoggedSettings, settings_of

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
    """Metadata of an acquisition; of a table under command what its controller says of itself."""
    version = identity.version.upper()
    # a virtual instrument says so itself; nothing simulated may pass for measured
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
        operator=plan.operator or _user_name(),
        filter=filter_of(plan, motion_of(plan)),
        reference_sha256=_reference_sha256(plan),
        effects_sha256=_effects_sha256(plan),
        software=f"imutui {imutui.__version__}, numpy {np.__version__}",
        stamps=STAMPS,
        source=identity.source,
        controller_identity=controller_identity,
    )
    return info.placed(plan.site, plan.gravity)


def _model(plan: Plan, identity: Identity) -> str:
    instrument = INSTRUMENTS[plan.instrument]
    return instrument.model if instrument.is_one_model else model_of(identity.version) or instrument.model


def _reference_sha256(plan: Plan) -> str:
    return hashlib.sha256(plan.reference_file[1].encode()).hexdigest() if plan.reference_file[0] else ""


def _effects_sha256(plan: Plan) -> str:
    if not plan.effects:
        return ""
    from imutui.logbook import effects_file

    return effects_file.digest(plan.effects.encode())


_CSV = (reference_file.ATTACHMENTS[1], "text/csv")
_WITHOUT_FILE = ("level", "gravity", "turned")


def reconfigured(plan: Plan, info: SessionInfo, changes: FilterChanges) -> tuple[Plan, SessionInfo]:
    """Plan and metadata with another reference or other effects; raises InputError if something is not known.

    A reference that needs no file lays the present one aside, and a file says itself which reference it is.
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
    info = replace(info, reference=plan.reference, reference_sha256=_reference_sha256(plan))
    return plan, replace(info, effects_sha256=_effects_sha256(plan), filter=filter_of(plan, motion_of(plan)))


def motion_of(plan: Plan) -> Profile | Trajectory | None:
    """Motion of the file that the reference comes from, if it comes from one."""
    name, text = plan.reference_file
    return reference_file.parse(name, text.encode()) if name else None


def filter_of(plan: Plan, motion: Profile | Trajectory | None) -> str:
    """Name of the filter that runs live: none with a profile that can only be found in the whole log afterwards."""
    return "none" if isinstance(motion, Profile) and motion.align == "gyro" else plan.filter


def effects_of(plan: Plan, info: SessionInfo) -> MakeEffects | None:
    """What makes the effects of the plan's effects file, if it has one."""
    if not plan.effects:
        return None
    # loads what makes effects of drivers, the signal library among it
    from imutui.logbook import effects_file

    return effects_file.maker(plan.effects.encode(), info)


def check_live(info: SessionInfo, motion: Profile | Trajectory | None, effects: MakeEffects | None = None) -> None:
    """Refuse, before the instrument is touched, what a filter cannot do live; raises InputError with the reason."""
    if info.noise == FROM_LOG:
        raise InputError(
            '`noise` is "log": it is measured on a whole log, so it cannot be used live. Record, then replay with'
            " --set filter.noise=log."
        )
    settings = info.settings(motion, effects=effects)
    if info.filter == "none":
        return
    if settings.reference not in ("level", "gravity") or effects is not None:
        # loads the filter, which what comes from no file need not wait for: nothing is left there to be refused
        from filters.kalman.runner import Estimator

        Estimator(settings)


def attach(writer: LogWriter, plan: Plan, now_ns: int) -> None:
    """Put the files of a plan, its reference and its effects, into a log under the names a replay looks for."""
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
    """What effects a file's text has, in words: channels and the effect; nothing for no text."""
    if not text:
        return ()
    from imutui.logbook import effects_file

    return tuple(f"{'/'.join(effect.channels)} {effect.effect}" for effect in effects_file.parse(text.encode()).effects)


def default_path(logs: Path, instrument: str, serial_number: str, note: str) -> Path:
    """Name of a recording that does not exist yet: kind of unit, as command lines call it, its number, UTC, note."""
    slug = re.sub(r"[^A-Za-z0-9]+", "-", note).strip("-").lower()[:40]
    utc = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(log_time.now_ns() // 1_000_000_000))
    stem = "_".join(part for part in (instrument, serial_number, utc, slug) if part)
    path, number = logs / f"{stem}.mcap", 2
    while path.exists():
        path, number = logs / f"{stem}_{number}.mcap", number + 1
    return path


def _user_name() -> str:
    """Name of the user that runs this, or the id of one without a name."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())
