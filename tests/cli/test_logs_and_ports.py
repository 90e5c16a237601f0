"""`info`, `check`, `recover`, `devices`, `config`, as a user runs them."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest
from helpers.commands import imutui, imutui_json
from helpers.paths import SAMPLE
from helpers.processes import virtual_process
from rosbags.highlevel import AnyReader

from filters.errors import InputError
from imutui import config
from imutui.logbook import schemas
from imutui.settings import SETTINGS


@pytest.fixture
def damaged(home: Path) -> Path:
    """The sample with a byte flipped in the middle, and without its last bytes."""
    data = bytearray(SAMPLE.read_bytes())
    data[150_000] ^= 0x40
    (home / "damaged.mcap").write_bytes(data[:-2000])
    return home / "damaged.mcap"


def test_info_says_what_is_in_a_log(home: Path) -> None:
    text = imutui("info", SAMPLE).stdout
    assert "SIMULATED" in text
    assert "520 samples of 3,469 packets" in text
    assert "19.997 Hz measured, 20 Hz asked for, stream" in text
    assert "degC" in text
    # the sample is of a version that wrote no transform, and is read all the same; no table was commanded
    assert all((topic in text) == (topic not in (schemas.TRANSFORMS, schemas.STATE)) for topic in schemas.TYPES)
    assert max(map(len, text.splitlines())) <= 80
    document = imutui_json("info", SAMPLE)
    assert (document["kind"], document["samples"]) == ("simulated", 520)
    several = imutui("info", SAMPLE, "none.mcap", "--json", check=3)
    assert len(json.loads(several.stdout)) == 1
    assert "none.mcap: no such file" in several.stderr


def test_a_checksum_that_is_named_with_its_log_is_passed_over(home: Path) -> None:
    """A shell names both for `logs/*`; a checksum alone is named by mistake, and refused."""
    shutil.copy(SAMPLE, home / "a.mcap")
    digest = hashlib.sha256(SAMPLE.read_bytes()).hexdigest()
    (home / "a.mcap.sha256").write_text(f"{digest}  a.mcap\n")
    done = imutui("check", "a.mcap", "a.mcap.sha256")
    assert "passed over 1 checksum file: each is used with its log" in done.stderr
    imutui("check", "a.mcap.sha256", check=3)


def test_check_ends_with_what_it_found(damaged: Path) -> None:
    assert imutui("check", SAMPLE).stdout.startswith("fine: ")
    found = imutui("check", damaged, check=1).stdout
    assert found.startswith("4 findings: ")
    assert "where: 8,737 bytes at byte 144,676, between 12.0 and 13.0 s of the log" in " ".join(found.split())
    assert found.count("next: ") == 4
    document = imutui_json("check", damaged, check=1)
    assert [finding["code"] for finding in document["findings"]] == ["damage", "unfinished", "sequence", "gaps"]
    assert "is a folder" in imutui("check", damaged.parent, check=3).stderr


def test_recover_makes_a_file_that_others_open(damaged: Path) -> None:
    done = imutui("recover", damaged, "-o", "fixed.mcap", check=1)
    assert done.stdout.startswith("recovered in part: ")
    assert "between 12.0 and 13.0 s" in " ".join(done.stdout.split())
    with AnyReader([damaged.parent / "fixed.mcap"]) as bag:
        topics = [c.topic for c, _, data in bag.messages() if bag.deserialize(data, c.msgtype) is not None]
    assert topics.count(schemas.IMU) == 500
    again = imutui("recover", damaged, "-o", "fixed.mcap", check=2)
    assert "--force" in again.stderr
    document = imutui_json("recover", damaged, "-o", "fixed.mcap", "--force", check=1)
    assert document["samples"] == 500
    assert "itself" in imutui("recover", damaged, "-o", damaged, "--force", check=2).stderr
    assert [path.name for path in sorted(damaged.parent.glob("*.*"))] == [
        "damaged.mcap",
        "fixed.mcap",
        "fixed.mcap.sha256",
    ]


def test_recover_of_an_unfinished_log_is_fine(home: Path) -> None:
    (home / "a.mcap").write_bytes(SAMPLE.read_bytes()[:200_000])
    assert imutui("recover", "a.mcap", "-o", "b.mcap").stdout.startswith("recovered: ")
    assert imutui("check", "b.mcap").stdout.startswith("fine: ")


def test_a_mistyped_option_is_no_recovery(home: Path) -> None:
    shutil.copy(SAMPLE, home / "a.mcap")
    assert imutui("recover", "a.mcap", check=2).stdout == ""
    assert "mkdir -p none" in imutui("recover", "a.mcap", "-o", "none/b.mcap", check=2).stderr


def test_devices_asks_who_is_there_on_request(home: Path) -> None:
    with virtual_process("--serial-number", "4711") as (port, _):
        told = imutui_json("devices", port)
        text = imutui("devices", "--probe", port).stdout
    (found,) = told["ports"]
    assert (found["answers"], found["serial_number"]) == (True, "4711")
    assert told["acquisitions"] == []
    assert "#4711" in text
    absent = imutui("devices", "/dev/nowhere", check=1)
    assert "no answer" in absent.stdout
    assert "no such port" in absent.stdout
    listed = imutui_json("devices")
    assert all("answers" not in entry for entry in listed["ports"])


def test_configuration_is_shown_in_columns_with_sources_and_places(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "imutui.toml").write_text('[screen]\nplot = "sweep"\n[acquisiton]\nrate_hz = 3\n')
    monkeypatch.setenv("IMUTUI_SCREEN_GLYPS", "ascii")
    done = imutui("config", "--show")
    lines = done.stdout.splitlines()
    assert f"#   {home / 'imutui.toml'} (read)" in lines
    assert any("(not there)" in line for line in lines)
    settings = [line for line in lines if " = " in line]
    assert len({line.index(" = ") for line in settings}) == 1
    assert len({line.index("  # ") for line in settings}) == 1
    assert any(line.startswith("screen.plot ") and str(home / "imutui.toml") in line for line in settings)
    assert "did you mean `acquisition.rate_hz`?" in done.stderr
    assert "did you mean `IMUTUI_SCREEN_GLYPHS`?" in done.stderr
    (home / "again").mkdir()
    (home / "again" / "imutui.toml").write_text(done.stdout)
    assert config.load({}, home / "again").text("screen.plot") == "sweep"
    assert imutui_json("config")["files"][-1] == {
        "path": str(home / "imutui.toml"),
        "read": True,
    }


ALLOWED = {key: each.allowed for key, each in SETTINGS.items() if each.allowed}


@pytest.mark.parametrize("key", ALLOWED)
def test_a_setting_that_is_one_of_a_few_is_held_to_them(tmp_path: Path, key: str) -> None:
    name = "IMUTUI_" + key.upper().replace(".", "_")
    with pytest.raises(InputError, match=f"{name}: `{key}` is .*not one of: .*{ALLOWED[key][0]}") as error:
        config.load({name: "7" if isinstance(ALLOWED[key][0], int) else "nonsense"}, tmp_path)
    assert all(str(value) in str(error.value) for value in ALLOWED[key])
    for value in ALLOWED[key]:
        assert config.load({name: str(value)}, tmp_path).settings[key].value == value


def test_numbers_that_are_none_are_refused(tmp_path: Path) -> None:
    for text, said in (
        ("[acquisition]\nbaud = 38400.5", "not a whole number"),
        ("[acquisition]\nrate_hz = inf", "not a finite number"),
        ("[acquisition]\nrate_hz = true", "not a finite number"),
        ("[paths]\nlogs = ['a']", "not a text"),
        ("[screen]\nfps = -1", "from 0 on"),
    ):
        (tmp_path / "imutui.toml").write_text(text)
        with pytest.raises(InputError, match=said):
            config.load({}, tmp_path)
    (tmp_path / "imutui.toml").write_text("[acquisition]\ntable = 3\nbaud = 38400.0")
    loaded = config.load({}, tmp_path)
    assert loaded.text("acquisition.table") == "3"
    assert loaded.number("acquisition.baud") == 38400
