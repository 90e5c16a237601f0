"""What a host asked a 440, 380 or 381 for, in words for a log."""

from imutui.instrument.uut.messages import (
    Echo,
    GetFields,
    GetPacket,
    OtherFrame,
    Ping,
    ReadFactoryWords,
    Request,
    Reset,
    SetFields,
)
from imutui.instrument.uut.payloads import frame_of


def in_words(request: Request) -> str:
    """Say what a request asks for.

    `request`: as received.
    Returns such as ``SF: set in RAM 0001=0000``.
    """
    match request:
        case Ping():
            meaning = "ping"
        case Reset():
            meaning = "restart"
        case Echo(payload):
            meaning = f"echo of {len(payload)} bytes"
        case GetPacket(kind):
            meaning = f"one packet of {_letters(kind)}"
        case GetFields(memory, ids):
            meaning = f"read from {memory.value} " + " ".join(f"{number:04x}" for number in ids)
        case SetFields(memory, values):
            meaning = f"set in {memory.value} " + " ".join(f"{number:04x}={value:04x}" for number, value in values)
        case ReadFactoryWords(address, count):
            meaning = f"{count} words of the factory's memory from {address:04x}"
        case OtherFrame(_, payload):
            meaning = f"unknown, with {len(payload)} bytes"
    return f"{_letters(frame_of(request).type)}: {meaning}"


def _letters(kind: bytes) -> str:
    return ascii(kind.decode("latin-1"))[1:-1]
