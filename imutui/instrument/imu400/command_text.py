"""What a host asked an IMU400CD for, in words for a log."""

from imutui.instrument.imu400.messages import (
    AskSerialNumber,
    AskVersion,
    Command,
    GetPacket,
    MeasureBaud,
    Ping,
    RequestBaud,
    SetMode,
    StartStream,
    StopStream,
    UnknownCommand,
    ZeroRateSensors,
    encode,
)


def in_words(command: Command) -> str:
    """Say what a command asks for.

    `command`: as received.
    Returns such as ``c: scaled mode``.
    """
    letter = ascii(encode(command)[:1].decode("latin-1"))[1:-1]
    match command:
        case Ping():
            meaning = "ping"
        case SetMode(mode):
            meaning = f"{mode.value} mode"
        case StopStream():
            meaning = "stop, polled mode"
        case StartStream():
            meaning = "stream, continuous mode"
        case GetPacket():
            meaning = "one packet"
        case AskSerialNumber():
            meaning = "serial number"
        case AskVersion():
            meaning = "version"
        case ZeroRateSensors(argument):
            meaning = f"zero the rate sensors, argument {argument}"
        case RequestBaud():
            meaning = "change of baud rate announced"
        case MeasureBaud():
            meaning = "measure the baud rate"
        case UnknownCommand(byte):
            meaning = f"unknown command 0x{byte:02x}, ignored"
    return f"{letter}: {meaning}"
