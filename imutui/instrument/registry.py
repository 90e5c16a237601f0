"""The instruments that there are, by name."""

from imutui.instrument.imu400.instrument import IMU400CD
from imutui.instrument.instrument import Instrument

INSTRUMENTS: dict[str, Instrument] = {each.name: each for each in (IMU400CD,)}

DEFAULT = IMU400CD.name
"""The one that is meant unless another is named."""
