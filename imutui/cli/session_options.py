"""From configuration to the records that the rest of the program takes."""

import contextlib
import importlib.util
import ipaddress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imutui.cli.exit_codes import say
from imutui.config import Config
from imutui.session.plan import Plan

if TYPE_CHECKING:
    from imutui.logbook.session_info import SessionInfo


def site_of(config: Config, site: tuple[float, float, float] | None) -> tuple[float, float, float]:
    """Latitude, longitude (degrees), height (m): the flag's, else the configuration's."""
    return site or (
        config.number("site.latitude_deg"),
        config.number("site.longitude_deg"),
        config.number("site.height_m"),
    )


def session_from(config: Config, site: tuple[float, float, float] | None) -> "SessionInfo":
    """Session of an imported recording, as far as configuration and flags tell."""
    from filters.state import Site
    from imutui.logbook.session_info import SessionInfo

    latitude, longitude, height = site_of(config, site)
    gravity = Site.at(latitude, longitude, height, config.number("site.gravity_mps2") or None).gravity
    return SessionInfo(
        accel_sign=config.integer("instrument.accel_sign"),
        mount=config.text("instrument.mount"),
        gyro_sign=config.text("instrument.gyro_sign"),
        g_unit=config.number("instrument.g_unit"),
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        gravity_mps2=gravity,
        reference=config.text("filter.reference"),
        filter=config.text("filter.name"),
        measurements=config.text("filter.measurements"),
        seed=config.integer("filter.seed"),
        kappa=config.number("filter.kappa"),
        noise=config.text("filter.noise"),
    )


_OF_INSTRUMENT = {
    "rate_hz": "acquisition.rate_hz",
    "baud": "acquisition.baud",
    "accel_sign": "instrument.accel_sign",
    "rate_range_dps": "instrument.rate_range_dps",
    "accel_range_g": "instrument.accel_range_g",
}
"""Fields of a plan that are the instrument's own where nobody chose, and their settings."""


def plan_from(config: Config, site: tuple[float, float, float] | None, *, checked: bool = True, **fields: Any) -> Plan:
    """Plan of an acquisition from configuration, flags, and the fields that are no setting.

    `config`: effective settings.
    `site`: latitude, longitude, height of a flag.
    `checked`: whether to refuse here what the filter could not run with. That loads the filters, which takes a second
      or two; a plan that only fills a form is checked by the acquisition, when it is started.
    `**fields`: of the plan.
    Raises InputError if something asked cannot be; the message names it.
    """
    chosen = tuple(field for field, key in _OF_INSTRUMENT.items() if config.settings[key].source != "default")
    plan = Plan(
        explicit=chosen,
        rate_hz=config.number("acquisition.rate_hz"),
        sampling=config.text("acquisition.sampling"),
        baud=config.integer("acquisition.baud"),
        filter=config.text("filter.name"),
        reference=config.text("filter.reference"),
        logs=str(Path(config.text("paths.logs")).resolve()),
        file_mode=config.text("paths.file_mode"),
        min_free_mb=config.number("paths.min_free_mb"),
        operator=config.text("acquisition.operator"),
        place=config.text("acquisition.place"),
        table=config.text("acquisition.table"),
        rotate_minutes=config.number("acquisition.rotate_minutes"),
        rotate_mb=config.number("acquisition.rotate_mb"),
        foxglove_port=config.integer("foxglove.port"),
        foxglove_host=config.text("foxglove.host"),
        accel_sign=config.integer("instrument.accel_sign"),
        mount=config.text("instrument.mount"),
        gyro_sign=config.text("instrument.gyro_sign"),
        g_unit=config.number("instrument.g_unit"),
        rate_range_dps=config.number("instrument.rate_range_dps"),
        accel_range_g=config.number("instrument.accel_range_g"),
        site=site_of(config, site),
        gravity=config.number("site.gravity_mps2") or None,
        measurements=config.text("filter.measurements"),
        seed=config.integer("filter.seed"),
        kappa=config.number("filter.kappa"),
        noise=config.text("filter.noise"),
        **fields,
    )
    for warning in config.warnings:
        say(f"imutui: {warning}")
    if (plan.rotate_minutes or plan.rotate_mb) and not plan.rotates:
        say(
            "imutui: the recording stays in one file: its reference is told from one log's first sample on, so a second"
            " file could not use it"
        )
    if checked:
        _refuse(plan)
    return plan


def check_stream(plan: Plan) -> None:
    """Refuse a stream that lacks its library, and say of one that others than this computer can reach that it is so."""
    from imutui.cli.exit_codes import USAGE, fail
    from imutui.cli.installed_from import command_for

    if not plan.foxglove_port:
        return
    if importlib.util.find_spec("foxglove") is None:
        raise fail(
            USAGE,
            "a stream for Foxglove needs foxglove-sdk, which is not installed here. Type this, then the same command"
            f" again:\n\n    {command_for('live')}\n",
        )
    if not _is_loopback(plan.foxglove_host):
        say(
            f"imutui: the stream for Foxglove is served at {plan.foxglove_host}, port {plan.foxglove_port}: whoever"
            " reaches this computer can watch, without a password and unencrypted"
        )


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return False


def _refuse(plan: Plan) -> None:
    """Refuse what the filter could not run with, before the instrument is touched."""
    from imutui.logbook.session_info import SessionInfo
    from imutui.session.metadata import check_live, effects_of, filter_of, motion_of

    motion = motion_of(plan)
    filter_name = filter_of(plan, motion)
    if filter_name != plan.filter:
        say(
            "imutui: recorded without the filter: its profile is found in the whole log afterwards, by the gyros."
            " `imutui trace` and `imutui replay` take the log with it"
        )
    probe = SessionInfo(
        mount=plan.mount,
        accel_sign=plan.accel_sign,
        gyro_sign=plan.gyro_sign,
        filter=filter_name,
        reference=plan.reference,
        measurements=plan.measurements,
        seed=plan.seed,
        kappa=plan.kappa,
        noise=plan.noise,
        g_unit=plan.g_unit,
        rate_hz=plan.rate_hz,
        gravity_mps2=plan.gravity if plan.gravity is not None else SessionInfo().gravity_mps2,
    )
    probe.axes()
    check_live(probe, motion, effects_of(plan, probe))
