"""Estimates of `filters.fleet` as fields of a summary, and what they leave undetermined, in sentences."""

from filters.fleet.components import Component, Fleet
from filters.fleet.mixture import Estimate
from filters.fleet.readings import PowerOns, Repeatability
from imutui.jobs.campaign.summary_document import ComponentField, EstimateField, RepeatField


def estimate(found: Estimate | None) -> EstimateField | None:
    """A value as a field."""
    if found is None:
        return None
    return {"value": found.value, "sd": found.sd, "low": found.low, "high": found.high}


def component(found: Component | None) -> ComponentField | None:
    """A component as a field."""
    return None if found is None else {"sd": found.sd, "low": found.low, "high": found.high, "dof": found.dof}


def repeat(found: Repeatability | None) -> RepeatField | None:
    """Agreement within power-ons as a field."""
    return None if found is None else {"chi2": found.chi2, "dof": found.dof, "p": found.p, "scale": found.scale}


def undetermined(fleet: Fleet, data: PowerOns) -> list[str]:
    """What these units and power-ons do not tell apart, and what would."""
    one_unit = fleet.model is None
    told = []
    if one_unit:
        told.append(
            f"Only unit {data.units[0]}: its own part is not told apart from the model's. A second unit would do it."
        )
    if fleet.between_power_ons is None:
        whose = "This unit was" if one_unit else "Each unit was"
        told.append(
            f"{whose} switched on once only: the day's part is not told apart from the unit's. A second power-on of any"
            " unit would do it."
        )
    return told
