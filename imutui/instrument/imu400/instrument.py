"""The IMU400CD as a member of the registry."""

from filters.imu import LOOP_HZ
from imutui.instrument import names
from imutui.instrument.imu400 import zeroing
from imutui.instrument.imu400.host import COUNTER, Imu400Host
from imutui.instrument.imu400.messages import PACKET_BYTES, POWER_UP_BAUD
from imutui.instrument.imu400.scaling import COUNT_LIMITS, Scaling
from imutui.instrument.instrument import Instrument

IMU400CD = Instrument(
    name=names.IMU400CD,
    models=("IMU400",),
    model="IMU400CD-200",
    is_one_model=True,
    power_up_bauds=(POWER_UP_BAUD,),
    packet_bytes=PACKET_BYTES,
    rates_hz=(133.0,),
    low_pass_loop_hz=LOOP_HZ,
    accel_sign=-1,
    turns_axes=False,
    mode="scaled mode",
    mode_words="scaled: deg/s and g from the unit; voltage mode is not used",
    counter=COUNTER,
    count_limits=COUNT_LIMITS,
    rate_range_dps=Scaling.rate_range_dps,
    accel_range_g=Scaling.accel_range_g,
    scaling=Scaling,
    zeroes_rates=True,
    check_zeroing=zeroing.check,
    zeroing_patience_s=zeroing.patience_s,
    status_names=None,
    host=Imu400Host,
)
"""Crossbow's IMU400CD."""
