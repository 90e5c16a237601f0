"""Every setting, once: key, default, limits, option, help, and label in forms.

The configuration, the options of commands, the fields of a plan and of a log's metadata, the forms and the pages of
the documentation are made from these declarations. A setting whose default is None is the unit's own where the user
does not state it. To add one, declare a field here and read it where it takes effect.
"""

from dataclasses import dataclass, field, fields
from functools import cache
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

from filters.channels import PAPER_PLACE, STANDARD_GRAVITY
from imutui.declared import Meta
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line


class Setting(NamedTuple):
    """How a setting is called; its field in a record has type, limits and default."""

    key: str  # in the configuration
    flag: str = ""  # option of commands
    metavar: str | None = None  # what stands for the value in help; None for the option's type
    help: str = ""
    label: str = ""  # in a form
    offers: tuple[tuple[str, str], ...] = ()  # values that the form to connect offers, and what each means


def _setting(default: Any, key: str, *called: Any, **other: Any) -> Any:
    return field(default=default, metadata={"setting": Setting(key, *called, **other)})


Name = Annotated[str, Meta(make=lambda text: one_line(text, NAME_LIMIT))]
Note = Annotated[str, Meta(make=lambda text: one_line(text, NOTE_LIMIT))]
NotNegative = Annotated[float, Meta(least=0.0)]
Range = Annotated[float, Meta(least=0.0, most=1e6)]
FileMode = Annotated[str, Meta(allowed=("0600", "0640", "0644", "0660", "0664", "0666"))]
AccelSign = Annotated[int, Meta(allowed=(-1, 1))]
FilterName = Annotated[str, Meta(allowed=("spkf", "spkf-paper", "ekf", "none"))]
Sampling = Annotated[str, Meta(allowed=("stream", "polled"))]
_FILTERS = ("spkf", "sigma points"), ("spkf-paper", "as the paper has it"), ("ekf", "extended"), ("none", "record only")
_REFERENCES = ("level", "still and level, north-east-down"), ("gravity", "still, tilt not known")
_SAMPLINGS = ("stream", "every packet, or means of them"), ("polled", "one packet asked for each period")


@dataclass(frozen=True, kw_only=True, init=False, repr=False, eq=False)
class ReadingSettings:
    """What readings mean, and how they are filtered."""

    # rate_range_dps, accel_range_g: full scale of the instrument's counts
    rate_range_dps: Range | None = _setting(None, "instrument.rate_range_dps")
    accel_range_g: Range | None = _setting(None, "instrument.accel_range_g")
    g_unit: Annotated[float, Meta(least=1.0, most=100.0)] = _setting(STANDARD_GRAVITY, "instrument.g_unit")
    # accel_sign, mount, gyro_sign: the axis map, see `filters.imu.AxisMap`
    accel_sign: AccelSign | None = _setting(
        None, "instrument.accel_sign", "--accel-sign", "-1|+1",
        "-1: reads +1 g on Z when level, Z down. +1: reads specific force.",
    )  # fmt: skip
    mount: str = _setting(
        "x,y,z", "instrument.mount", "--mount", None, 'Table x, y, z in instrument axes, such as "x,-y,-z".'
    )
    gyro_sign: str = _setting(
        "1,1,1", "instrument.gyro_sign", "--gyro-sign", None, 'Signs of the gyro readings, such as "-1,1,1".'
    )
    # filter, reference, measurements, seed, kappa, noise: see `filters.kalman.settings.Settings`
    filter: FilterName = _setting(
        "spkf", "filter.name", "--filter", "spkf|spkf-paper|ekf|none", "Filter to run.", "filter", _FILTERS
    )
    reference: str = _setting("level", "filter.reference", label="reference", offers=_REFERENCES)
    measurements: Annotated[str, Meta(allowed=("exact", "drawn"))] = _setting("exact", "filter.measurements")
    seed: Annotated[int, Meta(least=0)] = _setting(0, "filter.seed")
    kappa: Annotated[float, Meta(least=-15.0, most=1e6)] = _setting(0.0, "filter.kappa")
    noise: Annotated[str, Meta(allowed=("table1", "log"))] = _setting("table1", "filter.noise")


@dataclass(frozen=True, kw_only=True, init=False, repr=False, eq=False)
class LoggedSettings(ReadingSettings):
    """Settings of an acquisition that its logs state."""

    rate_hz: float | None = _setting(
        None, "acquisition.rate_hz", "--rate", "HZ", "Output rate, 0.1 to 133 Hz. An IMU381 gives 100 Hz at most.",
        "rate, Hz",
    )  # fmt: skip
    sampling: Sampling = _setting(
        "stream", "acquisition.sampling", "--sampling", "stream|polled",
        "What the unit streams, or means of it over each period; or one request a period.", "sampling", _SAMPLINGS,
    )  # fmt: skip
    baud: Annotated[int, Meta(least=1)] | None = _setting(None, "acquisition.baud", "--baud", None, "Line speed.")
    # operator, place, table: who, where in words, which turn table
    operator: Name = _setting("", "acquisition.operator", "--operator", None, "Who; goes into the file.", "operator")
    place: Name = _setting("", "acquisition.place", "--place", None, "Where, in words; goes into the file.", "place")
    table: Name = _setting(
        "", "acquisition.table", "--table", None, "Which turn table; goes into the file.", "table id"
    )


@dataclass(frozen=True, kw_only=True, init=False, repr=False, eq=False)
class AcquisitionSettings(LoggedSettings):
    """Settings of an acquisition."""

    logs: str = _setting("./logs", "paths.logs")  # folder of recordings
    file_mode: FileMode = _setting("0640", "paths.file_mode")  # permissions of logs, octal
    # megabytes that the disk keeps free: recording does not start, and stops, below; 0 for no limit
    min_free_mb: NotNegative = _setting(200.0, "paths.min_free_mb")
    # rotate_minutes, rotate_mb: see `imutui.session.plan.Plan.rotates`
    rotate_minutes: NotNegative = _setting(
        0.0, "acquisition.rotate_minutes", "--rotate-minutes", "MIN",
        "Begin another file after so many minutes; 0 for never.", "new file every, min",
    )  # fmt: skip
    rotate_mb: NotNegative = _setting(
        0.0, "acquisition.rotate_mb", "--rotate-mb", "MB",
        "Begin another file after so many megabytes; 0 for never.", "or every, MB",
    )  # fmt: skip
    # foxglove_port, foxglove_host: where `imutui foxglove` serves the logs; port 0: not at all
    foxglove_port: Annotated[int, Meta(least=0)] = _setting(
        0, "foxglove.port", "--foxglove", "PORT",
        "Serve what is recorded to Foxglove at this TCP port; other units of a batch at the next ones.",
    )  # fmt: skip
    foxglove_host: str = _setting(
        "127.0.0.1", "foxglove.host", "--foxglove-host", "ADDR",
        "Address to serve at; 127.0.0.1, this computer, unless given.",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, init=False, repr=False, eq=False)
class AllSettings(AcquisitionSettings):
    """All that the configuration has."""

    # pages beside Foxglove's that may read the stream, such as https://viewer.example.org
    foxglove_origins: str = _setting("", "foxglove.origins")
    latitude_deg: Annotated[float, Meta(least=-90.0, most=90.0)] = _setting(PAPER_PLACE[0], "site.latitude_deg")
    longitude_deg: Annotated[float, Meta(least=-360.0, most=360.0)] = _setting(PAPER_PLACE[1], "site.longitude_deg")
    height_m: Annotated[float, Meta(least=-1e5, most=1e6)] = _setting(PAPER_PLACE[2], "site.height_m")
    # 0: WGS-84 normal gravity at the site
    gravity_mps2: Annotated[float, Meta(least=0.0, most=100.0)] = _setting(
        0.0, "site.gravity_mps2", "--gravity", "M_S2", "Local gravity; WGS-84 normal gravity at the site unless given."
    )
    fps: NotNegative = _setting(0.0, "screen.fps")  # 0: 10, and 5 over SSH
    # auto: scroll, and less where the terminal does not keep up
    plot: Annotated[str, Meta(allowed=("auto", "scroll", "sweep", "numbers"))] = _setting("auto", "screen.plot")
    glyphs: Annotated[str, Meta(allowed=("auto", "braille", "block", "ascii"))] = _setting("auto", "screen.glyphs")
    theme: str = _setting("", "screen.theme")


class Declared(NamedTuple):
    """A setting as a field of one of the records."""

    name: str
    setting: Setting
    default: Any  # None: as the unit has it
    shape: Any  # type as it is declared, without None

    @property
    def kind(self) -> type:
        """Type of the value: str, int or float."""
        kind: type = getattr(self.shape, "__origin__", self.shape)
        return kind

    @property
    def allowed(self) -> tuple[Any, ...]:
        """The only values; empty where others are possible."""
        return next((each.allowed for each in get_args(self.shape)[1:]), ())


@cache
def settings_of(record: type) -> dict[str, Declared]:
    """Return the settings of a record by their keys, in the order of sections."""
    hints = get_type_hints(record, include_extras=True)
    found = []
    for each in fields(record):
        shape = hints[each.name]
        shape = get_args(shape)[0] if each.default is None else shape
        found.append(Declared(each.name, each.metadata["setting"], each.default, shape))
    order = ("paths", "instrument", "acquisition", "foxglove", "site", "filter", "screen")
    found.sort(key=lambda each: order.index(each.setting.key.partition(".")[0]))
    return {each.setting.key: each for each in found}


SETTINGS = settings_of(AllSettings)
