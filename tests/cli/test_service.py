"""`imutui service`: the unit, its settings, the udev rule, and what verifies them. No service manager runs here."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from helpers.commands import imutui, imutui_json

from filters.errors import InputError
from imutui.service import udev_rule, user_unit
from imutui.service.udev_rule import UsbAdapter

_KEY = r'[A-Z_]+(\{[^}"]+\})?(==|!=|\+=|=)"[^"]*"'
FTDI = UsbAdapter("0403", "6001", "A50285BI", "00", "1-1.2")


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of programs that comes first."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    return folder


def script(path: Path, text: str) -> None:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def plugged_in(sys: Path, serial: str = "") -> None:
    """What the kernel says of an adapter at socket 1-1.2, as ttyUSB0."""
    usb = sys / "devices/usb1/1-1.2"
    port = usb / "1-1.2:1.0/ttyUSB0"
    port.mkdir(parents=True)
    (sys / "class/tty/ttyUSB0").mkdir(parents=True)
    (sys / "class/tty/ttyUSB0/device").symlink_to(port)
    (port.parent / "bInterfaceNumber").write_text("00\n")
    texts = {"idVendor": "0403\n", "idProduct": "6001\n"} | ({"serial": f"{serial}\n"} if serial else {})
    for name, text in texts.items():
        (usb / name).write_text(text)


# -- the unit ----------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not here: package systemd")
def test_systemd_understands_the_unit(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert user_unit.verified(user_unit.text()) == ""
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    done = imutui("service", "--check")
    assert "systemd-analyze verify --user" in done.stdout
    assert done.stdout.count(": fine, ") == 2
    wrong = user_unit.text().replace("KillMode=control-group", "KillMode=gently").replace("Type=exec", "Tipe=exec")
    said = user_unit.verified(wrong) or ""
    assert "gently" in said
    assert "Tipe" in said


def test_without_systemd_analyze_nothing_is_called_verified(
    home: Path, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imutui.service.shutil.which", lambda *_, **__: None)
    document = imutui_json("service", "--check", check=1)
    assert document["unit"]["verified_by"] == []
    assert "no systemd-analyze" in document["unit"]["problems"][0]
    assert document["rule"] == document["rule"] | {"verified_by": ["imutui"], "problems": [], "installed": False}


def test_the_unit_runs_this_installation_unattended() -> None:
    """Its program is there; blanks and signs that mean something to systemd are no trouble."""
    (line,) = re.findall(r"^ExecStart=(.*)$", user_unit.text(), re.MULTILINE)
    words = line.split()
    assert Path(words[0]).is_file()
    assert words[words.index("record") :] == ["record", "--unattended", "--name", "%i", "--port", "${PORT}", "$OPTIONS"]
    assert user_unit._quoted("/a b/100%$x") == '"/a b/100%%$$x"'
    assert "@" not in user_unit.text().replace("imutui@", "")


def test_what_is_installed_lies_where_systemd_looks_and_is_not_replaced(home: Path) -> None:
    done = imutui("service", "--install", "--name", "table", "--port", "/dev/ttyUSB7")
    unit, settings = home / "config/systemd/user/imutui@.service", home / "config/imutui/table.env"
    assert unit.read_text() == user_unit.text()
    assert "PORT=/dev/ttyUSB7\n" in settings.read_text()
    assert f"IMUTUI_PATHS_LOGS={home}/logs\n" in settings.read_text()
    assert f"wrote {settings}" in done.stderr
    assert "systemctl --user enable --now imutui@table" in done.stdout
    assert "loginctl enable-linger" in done.stdout
    assert "unit and settings: done" in done.stdout
    again = imutui("service", "--install", "--name", "table", "--port", "/dev/ttyUSB7")
    assert f"is there already: {unit}" in again.stderr
    settings.write_text("PORT=/dev/other\n")
    assert "--force" in imutui("service", "--install", "--name", "table", "--port", "/dev/ttyUSB7", check=2).stderr
    assert settings.read_text() == "PORT=/dev/other\n"
    imutui("service", "--install", "--name", "table", "--port", "/dev/ttyUSB7", "--force")
    assert "PORT=/dev/ttyUSB7\n" in settings.read_text()
    imutui("service", "--install", "--name", "second", "--port", "socket://host:1")
    assert "PORT=socket://host:1\n" in (home / "config/imutui/second.env").read_text()


VALUES = (
    "/dev/ttyUSB0",
    "a b",
    "it's",
    'say "x"',
    "back\\slash",
    "end\\",
    "two\nlines\nPORT=/dev/other",
    "# none",
    "  blanks ",
    "`t` $HOME ${X} %h",
    ";",
    "é\x1b[0m\t\r\n",
    "",
)
GENERATOR = Path("/usr/lib/systemd/user-environment-generators/30-systemd-environment-d-generator")


def as_systemd_reads(text: str) -> dict[str, str]:
    """Assignments of a file of settings by the rules of systemd's parser (src/basic/env-file.c), for quoted values.

    Not here: what lies outside quotes but plain characters, and single quotes.
    """
    found, at = dict[str, str](), 0
    while at < len(text):
        line = text[at:].partition("\n")[0]
        if line.startswith("#") or not line:
            at += len(line) + 1
            continue
        key, _, value = line.partition("=")
        if not value.startswith('"'):
            assert not set(value) & set("\"'\\\t")
            found[key], at = value, at + len(line) + 1
            continue
        at += len(key) + 2
        found[key] = ""
        while text[at] != '"':
            if text[at] == "\\":
                at += 1
                found[key] += text[at] if text[at] in '"\\`$' else "" if text[at] == "\n" else f"\\{text[at]}"
            else:
                found[key] += text[at]
            at += 1
        at += 1
        assert text[at] == "\n"
    return found


@pytest.mark.parametrize("value", VALUES)
def test_systemd_reads_the_settings_back(value: str, tmp_path: Path) -> None:
    text = user_unit.settings_text(value, f"/logs/{value}")
    read = as_systemd_reads(text)
    assert read["PORT"] == value
    assert read["IMUTUI_PATHS_LOGS"] == f"/logs/{value}"
    assert read.keys() == {"PORT", "OPTIONS", "IMUTUI_PATHS_LOGS"}
    if GENERATOR.exists() and value and "$" not in value:  # the same parser, but it expands $ and drops what is empty
        (tmp_path / "environment.d").mkdir()
        (tmp_path / "environment.d" / "a.conf").write_text(f"{text}END=1\n", newline="")
        done = subprocess.run([GENERATOR], env={"XDG_CONFIG_HOME": str(tmp_path)}, capture_output=True, check=True)
        (said,) = re.findall(rb"^PORT=(.*)$", done.stdout, re.MULTILINE)
        quoted = said.removeprefix(b'"').removesuffix(b'"')
        assert quoted.decode().encode("latin-1", "backslashreplace").decode("unicode_escape") == value
        assert b"END=1" in done.stdout


def test_what_systemd_refuses_is_refused_before() -> None:
    for value in ("a\udcff", "a\0b"):
        with pytest.raises(InputError, match="cannot stand in a file of settings"):
            user_unit.env_value(value)


def test_both_can_be_written_to_a_file(home: Path) -> None:
    for option, text in (("--unit", user_unit.text()), ("--udev", udev_rule.text())):
        assert imutui("service", option).stdout == text
        imutui("service", option, "-o", "file")
        assert Path("file").read_text() == text
        assert "--force" in imutui("service", option, "-o", "file", check=2).stderr
        Path("file").unlink()


# -- the rule ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("adapter", [None, FTDI, UsbAdapter("1a86", "7523", "", "01", "3-4")])
def test_the_rule_is_one_that_udev_understands(adapter: UsbAdapter | None) -> None:
    rule = udev_rule.text(adapter, "table")
    lines = [line for line in rule.splitlines() if line and not line.startswith("#")]
    keys = re.compile(rf"{_KEY}(, ?{_KEY})*,?")
    assert [line for line in lines if not keys.fullmatch(line)] == []
    jumps, labels = re.findall(r'GOTO="(\w+)"', rule), re.findall(r'^LABEL="(\w+)"', rule, re.MULTILINE)
    assert set(jumps) == set(labels)
    assert len(labels) == len(set(labels))
    assert all(rule.rindex(f'GOTO="{label}"') < rule.index(f'LABEL="{label}"') for label in labels)
    assert "@" not in rule
    for part in ('ENV{ID_MM_DEVICE_IGNORE}="1"', 'ATTR{device/latency_timer}="1"', 'MODE="0660"', "BRLTTY"):
        assert part in rule
    assert f'GROUP="{udev_rule.group()}"' in rule
    assert ('SYMLINK+="imutui-table"' in rule) == (adapter is not None)


def test_a_rule_for_one_adapter_knows_it_by_its_number_or_its_socket() -> None:
    """The usual cheap ones have no serial number: then it is the socket, and which port of the adapter always."""
    assert 'ATTRS{idProduct}=="6001", ATTRS{serial}=="A50285BI"' in udev_rule.text(FTDI, "a")
    numberless = udev_rule.text(UsbAdapter("1a86", "7523", "", "01", "3-4"), "a")
    assert 'ATTR{idProduct}=="7523", KERNEL=="3-4"' in numberless
    assert (
        'ENV{ID_USB_INTERFACE_NUM}=="01", ATTRS{idVendor}=="1a86", ATTRS{idProduct}=="7523", KERNELS=="3-4"'
        in numberless
    )
    with pytest.raises(ValueError, match="cannot stand in a udev rule"):
        udev_rule.text(UsbAdapter("0403", "6001", 'x", RUN+="rm', "00", "1-1"), "a")


def test_the_adapter_of_a_port_is_what_the_kernel_says(tmp_path: Path) -> None:
    plugged_in(tmp_path, "A50285BI")
    assert udev_rule.of_port("/dev/ttyUSB0", tmp_path) == FTDI
    (tmp_path / "imutui-table").symlink_to("/dev/ttyUSB0")
    assert udev_rule.of_port(str(tmp_path / "imutui-table"), tmp_path) == FTDI
    (tmp_path / "class/tty/ttyS0/device").mkdir(parents=True)
    with pytest.raises(InputError, match="needs no rule"):
        udev_rule.of_port("/dev/ttyS0", tmp_path)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("exit 0", ""),
        ("echo file:3 wrong; exit 1", "file:3 wrong"),
        ("echo Unknown command verb verify. >&2; exit 1", None),
    ],
)
def test_udev_itself_is_asked_where_it_can_verify(program: Path, answer: str, said: str | None) -> None:
    """Before systemd 254 it cannot, and what it says then is no finding."""
    script(program / "udevadm", answer)
    assert udev_rule.verified_by_udevadm(udev_rule.text()) == said


def test_a_rule_that_was_edited_is_verified_by_udev_or_not_at_all(
    home: Path, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(udev_rule, "FOLDER", Path("rules.d"))
    made = Path("rules.d") / udev_rule.file_name("default")
    made.parent.mkdir()
    made.write_text(udev_rule.text())
    script(program / "udevadm", "echo Unknown command verb verify. >&2; exit 1")
    rule = imutui_json("service", "--check", check=None)["rule"]
    assert rule == {"path": str(made), "installed": True, "verified_by": ["imutui"], "problems": []}
    made.write_text(udev_rule.text().replace("MODE=", "MOED="))
    rule = imutui_json("service", "--check", check=1)["rule"]
    assert rule["verified_by"] == []
    assert "not verified" in rule["problems"][0]
    script(program / "udevadm", "echo line 3: MOED is unknown; exit 1")
    rule = imutui_json("service", "--check", check=1)["rule"]
    assert rule == rule | {"verified_by": ["udevadm verify"], "problems": ["line 3: MOED is unknown"]}
