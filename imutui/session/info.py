"""What is known of an acquisition when it begins: the metadata of its logs, and their names."""

import getpass
import hashlib
import os
import re
import socket
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import imutui
from filters.inclusion import MakeEffects
from filters.motion import Profile
from filters.reference import Trajectory
from filters.runner import Estimator
from filters.state import Site
from imutui.instrument.port import Port
from imutui.logbook import effects, motions
from imutui.logbook.session import FROM_LOG, MEASURED, SIMULATED, UNKNOWN, SessionInfo
from imutui.session.connect import Identity
from imutui.session.plan import Plan

STAMPS = (
    "log_time: UTC at start plus monotonic clock, when the last byte was read. publish_time, header.stamp: sampling"
    " instant, from the time counter fitted to arrival less the packet's time on the line (stream), or arrival less"
    " that time (polled); of averaged samples the mean of their packets' instants."
)


def session_info(plan: Plan, port: Port, identity: Identity) -> SessionInfo:
    """Metadata of an acquisition."""
    version = identity.version.upper()
    # a virtual instrument says so itself; nothing simulated may pass for measured
    kind = SIMULATED if "VIRTUAL SIM" in version else UNKNOWN if "VIRTUAL" in version else MEASURED
    info = SessionInfo(
        serial_number=identity.serial_number,
        firmware=identity.version,
        kind=kind,
        accel_sign=plan.accel_sign,
        mount=plan.mount,
        gyro_sign=plan.gyro_sign,
        g_unit=plan.g_unit,
        rate_range_dps=plan.rate_range_dps,
        accel_range_g=plan.accel_range_g,
        sampling=plan.sampling,
        rate_hz=plan.rate_hz,
        port=plan.port if "://" in plan.port else port.name,
        baud=port.baud,
        host=socket.gethostname(),
        operator=plan.operator or _user(),
        note=plan.note,
        reference=plan.reference,
        filter=plan.filter,
        measurements=plan.measurements,
        seed=plan.seed,
        kappa=plan.kappa,
        noise=plan.noise,
        reference_sha256=hashlib.sha256(plan.reference_file[1].encode()).hexdigest() if plan.reference_file[0] else "",
        effects_sha256=effects.digest(plan.effects.encode()),
        software=f"imutui {imutui.__version__}, numpy {np.__version__}",
        stamps=STAMPS,
    )
    latitude, longitude, height = plan.site or (info.latitude_deg, info.longitude_deg, info.height_m)
    site = Site.at(latitude, longitude, height, plan.gravity)
    return replace(info, latitude_deg=latitude, longitude_deg=longitude, height_m=height, gravity_mps2=site.gravity)


def motion_of(plan: Plan) -> Profile | Trajectory | None:
    """Motion of the file that the reference comes from, if it comes from one."""
    name, text = plan.reference_file
    return motions.parse(name, text.encode()) if name else None


def effects_of(plan: Plan, info: SessionInfo) -> MakeEffects | None:
    """What makes the effects of the plan's effects file, if it has one."""
    return effects.maker(plan.effects.encode(), info)


def check_live(info: SessionInfo, motion: Profile | Trajectory | None, effects: MakeEffects | None = None) -> None:
    """Refuse, before the instrument is touched, what a filter cannot do live; raises ValueError with the reason."""
    if info.noise == FROM_LOG:
        raise ValueError(
            '`noise` is "log": it is measured on a whole log, so it cannot be used live. Record, then replay with'
            " --set filter.noise=log."
        )
    if info.filter != "none":
        Estimator(info.settings(motion, effects=effects))


def default_path(logs: Path, serial_number: str, note: str) -> Path:
    """Name of a recording that does not exist yet: unit, UTC, note."""
    slug = re.sub(r"[^A-Za-z0-9]+", "-", note).strip("-").lower()[:40]
    stem = "_".join(
        part for part in ("imu400cd", serial_number, time.strftime("%Y%m%dT%H%M%SZ", time.gmtime()), slug) if part
    )
    path, number = logs / f"{stem}.mcap", 2
    while path.exists():
        path, number = logs / f"{stem}_{number}.mcap", number + 1
    return path


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user id without a name
        return str(os.getuid())
