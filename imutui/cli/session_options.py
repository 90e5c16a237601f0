"""From configuration to the records that the rest of the program takes."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imutui.cli.exit_codes import say
from imutui.cli.options import ask_to_move
from imutui.config import Config
from imutui.session.plan import Plan
from imutui.settings import AcquisitionSettings, ReadingSettings

if TYPE_CHECKING:
    from filters.state import Place
    from imutui.logbook.session_info import SessionInfo


_PLACE = ("site.latitude_deg", "site.longitude_deg", "site.height_m")


def site_of(config: Config, site: "Place | None") -> "Place | None":
    """Return latitude, longitude (degrees) and height (m) from the flag, else from the configuration.

    None where neither states them: a height alone is no site.
    """
    if site is not None or all(config.settings[key].source == "default" for key in _PLACE[:2]):
        return site
    latitude, longitude, height = (config.number(key) for key in _PLACE)
    return latitude, longitude, height


def gravity_of(config: Config) -> float | None:
    """Return the local gravity that the configuration states, m/s²; None where it is that of the site."""
    return config.number("site.gravity_mps2") or None


def session_from(config: Config, site: "Place | None") -> "SessionInfo":
    """Return the session of an imported recording, as far as configuration and flags state it."""
    from imutui.logbook.session_info import FOREIGN, SessionInfo

    stated = {name: value for name, value in config.values(ReadingSettings).items() if value is not None}
    info = replace(FOREIGN, **({"accel_sign": SessionInfo().accel_sign} | stated))
    return info.placed(site_of(config, site), gravity_of(config))


def plan_from(config: Config, site: "Place | None", *, checked: bool = True, **fields: Any) -> Plan:
    """Plan of an acquisition from configuration, flags, and the fields that are no setting.

    `checked`: whether to refuse here what the filter could not run with. That loads the filters, which takes a second
      or two; a plan that only fills a form is checked by the acquisition, when it is started.
    Raises InputError if something asked cannot be; the message names it.
    """
    values = config.values(AcquisitionSettings) | fields
    values["logs"] = str(Path(values["logs"]).resolve())
    plan = Plan(site=site_of(config, site), gravity=gravity_of(config), **values)
    for warning in config.warnings:
        say(f"imutui: {warning}")
    if (plan.rotate_minutes or plan.rotate_mb) and not plan.rotates:
        say(
            "imutui: the recording stays in one file: its reference is told from one log's first sample on, so a second"
            " file could not use it"
        )
    if checked:
        for remark in refuse(plan):
            say(remark)
    return plan


def may_move(plan: Plan) -> Plan:
    """The plan of a profile that a table is to run, once somebody has said that it may; raises InputError else."""
    from imutui.session.guidance import guided
    from imutui.session.metadata import filter_of, motion_of

    motion = motion_of(plan)
    guided(motion, filter_of(plan, motion))
    ask_to_move(plan.controller, f"through {plan.reference_file[0]}", yes_move=plan.yes_move)
    return replace(plan, yes_move=True)


def refuse(plan: Plan) -> list[str]:
    """Refuse what the filter could not run with, before the instrument is touched; returns what is to be said.

    Raises InputError.
    """
    from imutui.session.metadata import check_live, effects_of, filter_of, motion_of, requested

    motion = motion_of(plan)
    filter_name = filter_of(plan, motion)
    probe = replace(requested(plan), filter=filter_name).placed(plan.site, plan.gravity)
    probe.axes()
    check_live(probe, motion, effects_of(plan, probe))
    if filter_name == plan.filter:
        return []
    return [
        "imutui: recorded without the filter: its profile is found in the whole log afterwards, by the gyros."
        " `imutui trace` and `imutui replay` take the log with it"
    ]
