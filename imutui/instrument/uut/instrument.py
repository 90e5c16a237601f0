"""The IMU381 and its relatives as a member of the registry."""

from filters.errors import InputError
from imutui.instrument import names
from imutui.instrument.instrument import Instrument
from imutui.instrument.uut.fields import RATE_OF_DIVIDER
from imutui.instrument.uut.frame_search import FIXED_LENGTHS
from imutui.instrument.uut.frames import OVERHEAD_BYTES
from imutui.instrument.uut.host import COUNTER, SPEEDS, UutHost
from imutui.instrument.uut.messages import names_of_bits
from imutui.instrument.uut.scaling import COUNT_LIMITS, Scaling


def check_zeroing(argument: int) -> None:
    """Refuse to zero the rate sensors.

    Raises InputError: always.
    """
    raise InputError("an IMU381 has no command that zeroes its rate sensors; take their biases from the filter")


def _scaling(rate_range_dps: float, accel_range_g: float) -> Scaling:
    """Scaling of all units of the family: the same, whatever their ranges."""
    return Scaling()


IMU381 = Instrument(
    name=names.IMU381,
    models=("IMU381", "IMU380", "DMU380", "DMU381", "IMU440"),
    model="IMU381ZA",
    is_one_model=False,
    power_up_bauds=SPEEDS[:4],
    packet_bytes=FIXED_LENGTHS[b"S1"] + OVERHEAD_BYTES,
    rates_hz=tuple(map(float, RATE_OF_DIVIDER.values())),
    # set in the unit; documents disagree which field is the rate sensors'
    low_pass_loop_hz=None,
    accel_sign=1,
    turns_axes=True,
    mode="packets S1",
    mode_words="packets S1: rates, forces, four temperatures, status word",
    counter=COUNTER,
    count_limits=COUNT_LIMITS,
    # what the words of all of them hold: the sensors of each are good for less
    rate_range_dps=630.0,
    accel_range_g=10.0,
    scaling=_scaling,
    zeroes_rates=False,
    check_zeroing=check_zeroing,
    zeroing_patience_s=lambda argument: 0.0,
    status_names=names_of_bits,
    host=UutHost,
)
"""Aceinna's IMU381, MEMSIC's IMU380, Crossbow's IMU440."""
