"""What is asked of an acquisition, as one record that travels to its process as JSON, and what can be asked."""

import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY
from filters.state import PAPER_PLACE as PAPER_PLACE
from filters.state import Place
from imutui import toml_text
from imutui.instrument.driver import Driver as Driver
from imutui.instrument.names import DEFAULT
from imutui.instrument.names import VIRTUAL_PORT as VIRTUAL_PORT
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.registry import of_model as of_model
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line
from imutui.table import acutrol
from imutui.table.motion import parse_limits

MIN_RATE_HZ = 0.1
MAX_RATE_HZ = INSTRUMENTS[DEFAULT].most_rate_hz
POWER_UP_BAUD = INSTRUMENTS[DEFAULT].power_up_bauds[0]
SAMPLINGS = ("stream", "polled")
_LONGEST_S = 10 * 366 * 86400.0
LOOPBACK = "127.0.0.1"
FILE_MODE = "0640"  # permissions of logs, unless configured
MIN_FREE_MB = 200.0  # megabytes that recording leaves free, unless configured


INSTRUMENT_NAMES = tuple(INSTRUMENTS)  # what files of all units begin with


@dataclass(frozen=True, slots=True)
class HistoryWish:
    """What a viewer lacks of a run's history."""

    run: int = 0  # the run that it has rows of; of another one all is sent
    # instants of the last rows that it has, s since the run's first sample; None if it has none
    estimates_s: float | None = None
    temperature_s: float | None = None


@dataclass(frozen=True, slots=True)
class RecordingWish:
    """What the operator says when a recording begins; None leaves it as the plan has it."""

    # note, operator, place, table: go into the file: remark, who, where in words, which turn table. Empty says that
    # there is none.
    note: str | None = None
    operator: str | None = None
    place: str | None = None
    table: str | None = None
    # rotate_minutes, rotate_mb: the file is finished, and the next one begun, after so many minutes or megabytes; 0 for
    # never
    rotate_minutes: float | None = None
    rotate_mb: float | None = None

    def __post_init__(self) -> None:
        _clean(self)


_TEXTS = {"note": NOTE_LIMIT, "operator": NAME_LIMIT, "place": NAME_LIMIT, "table": NAME_LIMIT}


def _not_given(rate_hz: float, *instruments: type[Driver]) -> str:
    gives = [f"the {each.model} gives {MIN_RATE_HZ} to {each.most_rate_hz:g} Hz" for each in instruments]
    return f"`rate` is {rate_hz:g} Hz; {', '.join(gives)}"


def _clean(record: "RecordingWish | Plan") -> None:
    """Make what is typed one line of bounded length each; raises InputError for what is no text."""
    for name, limit in _TEXTS.items():
        text = getattr(record, name)
        if text is None and isinstance(record, RecordingWish):
            continue
        if not isinstance(text, str):
            raise InputError(f"`{name}` is no text")
        object.__setattr__(record, name, one_line(text, limit))


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
    """Batch of an acquisition that is called BATCH:UNIT; empty of one alone."""
    return name.partition(":")[0] if ":" in name else ""


def check_rotation(minutes: float, mb: float) -> None:
    """Refuse limits of a file that make no sense; raises InputError."""
    for name, value, unit in (("rotate_minutes", minutes, "minutes"), ("rotate_mb", mb, "MB")):
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
            raise InputError(f"`{name}` is {value}, not a number of {unit}, or 0 for never")


@dataclass(frozen=True, slots=True)
class Plan:
    """One acquisition."""

    port: str  # path, stable id, pyserial URL, or "virtual"
    rate_hz: float = MAX_RATE_HZ  # output rate, 0.1 to 133 Hz
    # "stream": every packet at a rate that the unit has, else means over each period. "polled": one request a period.
    sampling: str = "stream"
    baud: int = POWER_UP_BAUD  # line speed
    duration_s: float | None = None  # ends by itself so many seconds after the first packet, gaps included
    record: bool = False  # whether recording starts with the first packet, or when a viewer asks
    # filter, reference: names; filter "none" records only
    filter: str = "spkf"
    reference: str = "level"
    name: str = "default"  # of the acquisition; one of a name a user. See `batch_of`.
    logs: str = "logs"  # folder of recordings, absolute
    file_mode: str = FILE_MODE  # permissions of files, octal, as "0640"
    # megabytes that the disk keeps free: recording does not start, and stops, below; 0 for no limit
    min_free_mb: float = MIN_FREE_MB
    # output, overwrite: file of the first recording instead of a name made up in `logs`, and whether it may replace one
    output: str = ""
    overwrite: bool = False
    # note, operator, place, table: go into the file: remark, who, where in words, which turn table
    note: str = ""
    operator: str = ""
    place: str = ""
    table: str = ""
    # rotate_minutes, rotate_mb: a file is finished, and the next one begun, after so many minutes or megabytes; 0 for
    # never. See `rotates`.
    rotate_minutes: float = 0.0
    rotate_mb: float = 0.0
    accel_sign: int = -1
    mount: str = "x,y,z"
    gyro_sign: str = "1,1,1"
    g_unit: float = STANDARD_GRAVITY
    rate_range_dps: float = INSTRUMENTS[DEFAULT].rate_range_dps
    accel_range_g: float = INSTRUMENTS[DEFAULT].accel_range_g
    # site, gravity: where the unit stands, and its local gravity, m/s²; both None where nobody stated the site
    site: Place | None = None
    gravity: float | None = None
    measurements: str = "exact"
    seed: int = 0
    kappa: float = 0.0
    noise: str = "table1"  # of the filter; "log" is refused, since it needs the whole log
    # name (its ending counts: .toml or .csv) and text of the file that the reference comes from, both empty if it comes
    # from none
    reference_file: tuple[str, str] = ("", "")
    effects: str = ""  # text of the effects file; empty for none
    # foxglove_port, foxglove_host: TCP port and address at which `imutui foxglove` serves the logs; port 0: not at all
    foxglove_port: int = 0
    foxglove_host: str = LOOPBACK
    unattended: bool = False  # nobody looks on: a recording names the one before it, be it finished
    # for port "virtual": ends by itself so many seconds after its last viewer has gone; see `ends_unwatched_s`
    unwatched_s: float = 60.0
    # controller, limits: URL of the table's controller, "" for none, "virtual" for that of a virtual unit's own table;
    # and what its axes may do, as `imutui.table.motion.parse_limits` reads it
    controller: str = ""
    limits: str = ""
    yes_move: bool = False  # somebody said that the table may move: the recording's profile is run on it
    needs_viewer: bool = False  # ends, and stops the table, soon after its last viewer has gone, who gave the motion
    virtual: tuple[str, ...] = ()  # further arguments of `imutui virtual`, for port "virtual"
    instrument: str = DEFAULT  # which kind of unit, by its name in the registry; empty for whichever answers
    explicit: tuple[str, ...] = ()  # fields that somebody chose: `of_instrument` leaves them as they are

    def __post_init__(self) -> None:
        if self.instrument and self.instrument not in INSTRUMENTS:
            raise InputError(f'`instrument` is "{self.instrument}", not one of: {", ".join(INSTRUMENTS)}')
        possible = [INSTRUMENTS[self.instrument]] if self.instrument else list(INSTRUMENTS.values())
        most = max(each.most_rate_hz for each in possible) if "rate_hz" in self.explicit else MAX_RATE_HZ
        if not MIN_RATE_HZ <= self.rate_hz <= most:
            raise InputError(_not_given(self.rate_hz, *possible))
        if self.sampling not in SAMPLINGS:
            raise InputError(f'`sampling` is "{self.sampling}", not one of: {", ".join(SAMPLINGS)}')
        if not self.baud > 0:
            raise InputError(f"`baud` is {self.baud}, no line speed; the unit starts at {POWER_UP_BAUD}")
        if self.duration_s is not None and not 0.0 < self.duration_s <= _LONGEST_S:
            raise InputError(f"`duration` is {self.duration_s:g} s; it must be positive and at most ten years")
        _clean(self)
        check_rotation(self.rotate_minutes, self.rotate_mb)
        self._check_table()
        if not self.name or "/" in self.name or self.name.startswith(".") or len(self.name) > 64:
            raise InputError(
                f'`name` is "{self.name}"; it becomes a file name, so no slash, no leading dot, at most 64 letters'
            )

    def _check_table(self) -> None:
        if self.controller:
            if not self.controller == self.port == VIRTUAL_PORT:
                acutrol.parse(self.controller)
            parse_limits(self.limits)

    def asking(self) -> "Plan":
        """The plan where whatever answers at its port is taken; a virtual instrument of its own is the usual one."""
        return replace(self, instrument=DEFAULT if self.port == VIRTUAL_PORT else "")

    def of_instrument(self, name: str) -> "Plan":
        """The plan for an instrument: what nobody chose is as that one has it.

        Raises InputError if it can't be asked of it.
        """
        instrument = INSTRUMENTS[name]
        if name == DEFAULT:
            return replace(self, instrument=name)
        if self.rate_hz > instrument.most_rate_hz and "rate_hz" in self.explicit:
            raise InputError(_not_given(self.rate_hz, instrument))
        chosen = set(self.explicit)
        return replace(
            self,
            instrument=name,
            rate_hz=min(self.rate_hz, instrument.most_rate_hz),
            accel_sign=self.accel_sign if "accel_sign" in chosen else instrument.accel_sign,
            rate_range_dps=self.rate_range_dps if "rate_range_dps" in chosen else instrument.rate_range_dps,
            accel_range_g=self.accel_range_g if "accel_range_g" in chosen else instrument.accel_range_g,
            baud=self.baud if "baud" in chosen else instrument.power_up_bauds[0],
        )

    @property
    def rotates(self) -> bool:
        """Whether files are finished, and next ones begun, while recording.

        Not where the reference comes from a file: that is told from one log's first sample on, so the next log could
        not use it.
        """
        return (self.rotate_minutes > 0.0 or self.rotate_mb > 0.0) and not self.reference_file[0]

    @property
    def ends_unwatched_s(self) -> float | None:
        """Seconds after which it ends by itself if nobody looks on; None where it measures, and goes on for ever."""
        return self.unwatched_s if self.port == VIRTUAL_PORT else None

    @property
    def mode(self) -> int:
        """Permissions of files, as the system takes them."""
        return int(self.file_mode, 8)

    def dumps(self) -> str:
        """JSON text, on one line, for the process that carries the plan out."""
        return json.dumps(asdict(self))

    @classmethod
    def loads(cls, text: str) -> "Plan":
        """Plan of the JSON text that `dumps` gives; raises InputError as the constructor does."""
        fields = json.loads(text)
        fields["virtual"] = tuple(fields["virtual"])
        fields["explicit"] = tuple(fields["explicit"])
        fields["reference_file"] = tuple(fields["reference_file"])
        fields["site"] = tuple(fields["site"]) if fields["site"] is not None else None
        return cls(**fields)

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
    """The demo: a virtual instrument with an effect to be found, recorded from the first packet as the defaults say."""
    scenario = Path(__file__).with_name("demo.toml")
    return Plan(
        VIRTUAL_PORT,
        rate_hz,
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
