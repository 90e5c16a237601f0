"""The plan of an acquisition, one record that travels to its process as JSON, and what viewers ask of it later."""

import json
from dataclasses import KW_ONLY, asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, TypedDict

from filters.errors import InputError
from filters.state import PAPER_PLACE as PAPER_PLACE
from filters.state import Place
from imutui import toml_text
from imutui.declared import Meta, read, settle
from imutui.instrument.driver import Driver as Driver
from imutui.instrument.names import DEFAULT
from imutui.instrument.names import VIRTUAL_PORT as VIRTUAL_PORT
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.registry import of_model as of_model
from imutui.plain_text import NAME_LIMIT
from imutui.settings import AcquisitionSettings, Name, Note, NotNegative
from imutui.table import acutrol
from imutui.table.motion import parse_limits

MIN_RATE_HZ = 0.1
MAX_RATE_HZ = INSTRUMENTS[DEFAULT].most_rate_hz
_LONGEST_S = 10 * 366 * 86400.0
_UNIT = {"rate_hz": "most_rate_hz", "accel_sign": "accel_sign",
         "rate_range_dps": "rate_range_dps", "accel_range_g": "accel_range_g"}  # fmt: skip
"""Settings that a unit has a value for, and their names in its class."""


INSTRUMENT_NAMES = tuple(INSTRUMENTS)  # what files of all units begin with


@dataclass(frozen=True, slots=True)
class HistoryWish:
    """Request for the part of a run's history that a viewer lacks."""

    run: int = 0  # the run of which it has rows; of another one all is sent
    # instants of the last rows that it has, s since the run's first sample; None if it has none
    estimates_s: float | None = None
    temperature_s: float | None = None


def _short(name: str) -> str:
    if len(name) > NAME_LIMIT:
        raise InputError(f"the reference's name is longer than {NAME_LIMIT} characters")
    return name


class FilterChanges(TypedDict, total=False):
    """Changes of the filter's input; a field that is absent stays as it is.

    `reference` is a name, `reference_file` name and text of a profile or trajectory, `effects` the text of an effects
    file, empty for none.
    """

    reference: str
    reference_file: Annotated[tuple[Annotated[str, Meta(make=_short)], str], Meta(words="a name and a text")]
    effects: str


@dataclass(frozen=True, slots=True)
class RecordingWish:
    """Fields that the operator states for a recording; None leaves a field as the plan has it, "" empties it.

    `note` is a remark; the other fields are settings.
    """

    note: Note | None = None
    operator: Name | None = None
    place: Name | None = None
    table: Name | None = None
    rotate_minutes: NotNegative | None = None
    rotate_mb: NotNegative | None = None

    def __post_init__(self) -> None:
        settle(self)


def _rate_words(rate_hz: float, *instruments: type[Driver]) -> str:
    gives = [f"the {each.model} gives {MIN_RATE_HZ} to {each.most_rate_hz:g} Hz" for each in instruments]
    return f"`rate` is {rate_hz:g} Hz; {', '.join(gives)}"


def _file_name(name: str) -> str:
    if not name or "/" in name or name.startswith(".") or len(name) > 64:
        raise InputError(f'`name` is "{name}"; it becomes a file name, so no slash, no leading dot, at most 64 letters')
    return name


def parse_place(text: str) -> Place:
    """Return latitude, longitude (degrees) and height (m) of "LAT,LON,H".

    Raises InputError if the text does not read so; the message begins with the text.
    """
    try:
        latitude, longitude, height = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f'"{text}", not LAT,LON,H in degrees and metres such as "-23.2,-45.9,641"') from None
    if not (-90.0 < latitude < 90.0 and -180.0 <= longitude <= 360.0):
        raise InputError(f'"{text}": latitude must lie within ±90 degrees, longitude within -180 to 360')
    if not -1e3 < height < 1e5:
        raise InputError(f'"{text}": height must be metres above the ellipsoid, within -1000 to 100000')
    return latitude, longitude, height


def batch_of(name: str) -> str:
    """Return the batch of an acquisition that is called BATCH:UNIT; empty for any other name."""
    return name.partition(":")[0] if ":" in name else ""


@dataclass(frozen=True, slots=True)
class Plan(AcquisitionSettings):
    """One acquisition. A setting that is None is as the unit has it."""

    port: str  # path, stable id, pyserial URL, or "virtual"
    _: KW_ONLY
    # ends by itself so many seconds after the first packet, gaps included
    duration_s: (
        Annotated[float, Meta(above=0.0, most=_LONGEST_S, words="a positive time in seconds, ten years at most")] | None
    ) = None
    record: bool = False  # whether recording starts with the first packet, or when a viewer asks
    name: Annotated[str, Meta(make=_file_name)] = "default"  # of the acquisition; one of a name a user. See `batch_of`.
    # output, overwrite: file of the first recording instead of a name made up in `logs`, and whether it may replace one
    output: str = ""
    overwrite: bool = False
    note: Note = ""  # remark, goes into the file
    # site, gravity: where the unit stands, and its local gravity, m/s²; both None where the user states no site
    site: tuple[float, float, float] | None = None
    gravity: float | None = None
    # name (its ending counts: .toml or .csv) and text of the file that the reference comes from, both empty if it comes
    # from none
    reference_file: tuple[str, str] = ("", "")
    effects: str = ""  # text of the effects file; empty for none
    unattended: bool = False  # run as a service: a recording names the one before it, finished or not
    # for port "virtual": ends by itself so many seconds after its last viewer has gone; see `ends_unwatched_s`
    unwatched_s: float = 60.0
    # controller, limits: URL of the table's controller, "" for none, "virtual" for that of a virtual unit's own table;
    # and what its axes may do, as `imutui.table.motion.parse_limits` reads it
    controller: str = ""
    limits: str = ""
    yes_move: bool = False  # the user has allowed the table to move: the recording's profile is run on it
    needs_viewer: bool = False  # ends, and stops the table, soon after its last viewer has gone, who gave the motion
    virtual: tuple[str, ...] = ()  # further arguments of `imutui virtual`, for port "virtual"
    # which kind of unit, by its name in the registry; empty for the one that answers
    instrument: Annotated[str, Meta(allowed=("", *INSTRUMENTS))] = DEFAULT

    def __post_init__(self) -> None:
        settle(self)
        possible = [INSTRUMENTS[self.instrument]] if self.instrument else list(INSTRUMENTS.values())
        most = max(each.most_rate_hz for each in possible)
        if self.rate_hz is not None and not MIN_RATE_HZ <= self.rate_hz <= most:
            raise InputError(_rate_words(self.rate_hz, *possible))
        if self.controller:
            if not self.controller == self.port == VIRTUAL_PORT:
                acutrol.parse(self.controller)
            parse_limits(self.limits)

    def of_instrument(self, name: str) -> "Plan":
        """Return the plan for an instrument: settings that are None become those of the instrument.

        The baud rate stays None: the unit is asked at which it speaks.
        Raises InputError if the instrument cannot do what the plan asks.
        """
        instrument = INSTRUMENTS[name]
        own = {field: getattr(instrument, of) for field, of in _UNIT.items() if getattr(self, field) is None}
        return replace(self, instrument=name, **own)

    @property
    def period_s(self) -> float:
        """Period of the samples, s; that of the unit's highest rate where the plan states none."""
        return 1.0 / (self.rate_hz or INSTRUMENTS[self.instrument or DEFAULT].most_rate_hz)

    @property
    def folder(self) -> Path:
        """Folder of the first recording."""
        return Path(self.output).parent if self.output else Path(self.logs)

    @property
    def rotates(self) -> bool:
        """True if a recording goes on in further files.

        It does not if the reference comes from a file, whose time counts from one log's first sample.
        """
        return (self.rotate_minutes > 0.0 or self.rotate_mb > 0.0) and not self.reference_file[0]

    @property
    def ends_unwatched_s(self) -> float | None:
        """Seconds without a viewer after which a virtual unit's acquisition ends; None of a real unit's."""
        return self.unwatched_s if self.port == VIRTUAL_PORT else None

    @property
    def mode(self) -> int:
        """Permissions of files, as the system takes them."""
        return int(self.file_mode, 8)

    def dumps(self) -> str:
        """Return JSON text on one line for the process that carries the plan out."""
        return json.dumps(asdict(self))

    @classmethod
    def loads(cls, text: str) -> "Plan":
        """Return the plan of the JSON text that `dumps` gives; raises InputError as the constructor does."""
        return read(json.loads(text), cls)

    def configuration(self) -> str:
        """Effective configuration as TOML, kept in the log."""
        lines = ["# effective configuration of the acquisition"]
        for key, value in asdict(self).items():
            if value is not None and key not in ("reference_file", "effects"):  # attachments of their own
                lines.append(f"{key} = {toml_text.value(value)}")
        return "\n".join(lines) + "\n"


DEMO_RATE_HZ = 20.0
STEADY = Path(__file__).with_name("steady.toml")  # scenario of the headless demo
DEMO = "demo"  # name and note of the demo's acquisition


def demo(defaults: Plan, rate_hz: float = DEMO_RATE_HZ, seed: int = 0) -> Plan:
    """Return the plan of the demo: a virtual instrument with an effect to be found, recorded from the first packet."""
    scenario = Path(__file__).with_name("demo.toml")
    return Plan(
        VIRTUAL_PORT,
        rate_hz=rate_hz,
        record=True,
        name=DEMO,
        note=DEMO,
        logs=defaults.logs,
        file_mode=defaults.file_mode,
        min_free_mb=defaults.min_free_mb,
        operator=defaults.operator,
        virtual=("--seed", str(seed), "--scenario", str(scenario)),
        controller=VIRTUAL_PORT,
        site=PAPER_PLACE,  # where the virtual unit stands, wherever the user does
    )
