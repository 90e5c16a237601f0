"""What a unit's packets say of the unit itself, in their status words: told, and never a reason to drop readings."""

from imutui.instrument.counts import DataPacket
from imutui.instrument.instrument import Instrument

_MOST_TOLD = 20


class StatusWords:
    """Follows the status words of an acquisition's packets.

    `instrument`: knows what their bits mean.
    """

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument
        self._newest = 0
        self._new = list[int]()
        self._seen = {0}

    def take(self, packet: DataPacket) -> None:
        """Take a packet."""
        details = packet.details
        if details is None or details.status == self._newest:
            return
        self._newest = details.status
        if self._newest not in self._seen and len(self._seen) <= _MOST_TOLD:
            self._seen.add(self._newest)
            self._new.append(self._newest)

    @property
    def newest(self) -> str:
        """The newest packet's word and what it means; "" if no bit is set, or packets have none."""
        return self._instrument.status_in_words(self._newest) if self._newest else ""

    def news(self) -> list[str]:
        """What to say of words that came for the first time, each once."""
        new, self._new = self._new, []
        return [
            f"the unit's status word (BIT) is {self._instrument.status_in_words(word)}; readings count whatever it says"
            for word in new
        ]
