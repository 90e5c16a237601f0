"""What an instrument is: its data, and what makes its host side."""

from collections.abc import Callable
from dataclasses import dataclass

from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.counts import COUNT_LIMITS, Scaling
from imutui.instrument.host import Host
from imutui.instrument.port import Port


@dataclass(frozen=True, slots=True)
class Instrument:
    """A kind of unit."""

    name: str  # how a command line calls it
    models: tuple[str, ...]  # what the models of such units begin with, in capitals
    model: str  # what a unit is that does not say its model
    power_up_bauds: tuple[int, ...]  # speeds of a line to a unit that was just switched on; the first is where to begin
    packet_bytes: int  # of a data packet on the line
    rates_hz: tuple[float, ...]  # rates of a stream; at each of them every packet is a sample
    accel_sign: int  # +1 if it reads specific force, -1 if its sign is the other
    # mode, mode_words: what its packets are, in two words and in a line
    mode: str
    mode_words: str
    counter: CounterSpec  # what its packets' counter counts
    # rate_range_dps, accel_range_g: ranges, unless the configuration has others, from which `scaling` has the size of a
    # count where units differ
    rate_range_dps: float
    accel_range_g: float
    scaling: Callable[[float, float], Scaling]  # makes the scaling from the ranges, deg/s and g
    check_zeroing: Callable[[int], None]  # raises InputError for an argument of zeroing that cannot be sent
    # makes the host side for an open port, and the rate of a stream, Hz, or None if packets are asked for
    host: Callable[[Port, float | None], Host]
    count_limits: tuple[int, int] = COUNT_LIMITS  # least and largest count; a reading there says only "this or more"
    is_one_model: bool = False  # whether every unit that its host accepts is of `model`, whatever it says of itself
    # rate of the loop that runs its low-pass filters, first order, at the limits of its specification, Hz; None where
    # the filters are others, or can be set
    low_pass_loop_hz: float | None = None
    turns_axes: bool = False  # whether its own configuration can turn the axes of its packets
    zeroes_rates: bool = False  # whether it has a command that zeroes its rate sensors
    # how long a unit may take to zero its rate sensors, by the argument, s
    zeroing_patience_s: Callable[[int], float] = lambda argument: 0.0
    # names of the bits that are set in a packet's status word; None where packets have no details, see
    # `counts.PacketDetails`
    status_names: Callable[[int], tuple[str, ...]] | None = None

    @property
    def most_rate_hz(self) -> float:
        """Samples a second at most."""
        return max(self.rates_hz)

    def gives(self, rate_hz: float) -> bool:
        """Whether a stream has such a rate, so that each packet is a sample; else samples are means of packets."""
        return rate_hz in self.rates_hz or rate_hz >= self.most_rate_hz

    def status_in_words(self, word: int) -> str:
        """A packet's status word and what its bits mean: "0x0002 (hardware error)"."""
        names = () if self.status_names is None else self.status_names(word)
        return f"0x{word:04X} ({', '.join(names) or 'nothing set'})"

    def packets_hz(self, rate_hz: float) -> float:
        """Packets a second of a stream for samples at such a rate; nominal."""
        return min(rate_hz, self.most_rate_hz) if self.gives(rate_hz) else self.most_rate_hz
