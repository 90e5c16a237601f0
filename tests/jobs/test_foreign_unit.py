"""A file that another program wrote: what it does not state of its unit is not stated, nor judged by another unit's."""

from pathlib import Path

import numpy as np
import pytest
from helpers import logs
from helpers.commands import imutui, imutui_json

from imutui.jobs import runs
from imutui.jobs.replay import replay
from imutui.logbook import reader
from imutui.logbook.reading import Reading
from imutui.report import replay_report, replay_text
from imutui.verdict import sources

OF_A_UNIT = ("IMU400CD", "Table 1", "200 deg/s", "4 g")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return logs.foreign(tmp_path / "bag.mcap")


def test_its_content_says_that_instrument_ranges_and_site_are_not_stated(path: Path) -> None:
    document = imutui_json("info", path)
    assert (document["instrument"], document["site_stated"]) == ("", False)
    assert (document["rate_range_dps"], document["accel_range_g"]) == (None, None)
    said = imutui("info", path).stdout
    assert "instrument    not stated\n" in said
    assert not [words for words in OF_A_UNIT if words in said]


def test_its_biases_are_judged_by_no_limit_and_its_noise_by_no_data_sheet(path: Path) -> None:
    document = replay(path, Reading())
    assert document["identity"]["instrument"] == ""
    assert document["noise"]["specification"] == {
        "gyro_arw_deg_sqrt_h": [None] * 3, "accel_vrw_mps_sqrt_h": [None] * 3,
    }  # fmt: skip
    document["final"]["gyro_bias_dps"][0] = 5.0
    (limit,) = [check for check in sources.of_document(document).checks if check.name == "limit"]
    assert (limit.level, limit.said) == ("none", "not judged: the data sheet of this unit is not known")
    said = replay_text.text(document, 200) + str(replay_report.article(document))
    assert not [words for words in OF_A_UNIT if words in said]


def test_an_import_states_the_instrument_and_the_ranges_that_it_was_told(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    n = 40
    np.savez(home / "a.npz", t=np.arange(n) / 20.0, gyro=np.zeros((n, 3)), accel=np.tile([0.0, 0.0, 1.0], (n, 1)))
    imutui("import", home / "a.npz", "-o", home / "a.mcap")
    said = imutui("info", home / "a.mcap").stdout
    assert "instrument    not stated\n" in said
    assert "ranges\n              not stated" in said
    assert not [words for words in OF_A_UNIT if words in said]
    monkeypatch.setenv("IMUTUI_INSTRUMENT_RATE_RANGE_DPS", "300")
    monkeypatch.setenv("IMUTUI_INSTRUMENT_ACCEL_RANGE_G", "8")
    imutui("import", home / "a.npz", "-o", home / "b.mcap", "--instrument", "ADIS16405")
    told = imutui_json("info", home / "b.mcap")
    assert (told["instrument"], told["rate_range_dps"], told["accel_range_g"]) == ("ADIS16405", 300.0, 8.0)


def test_a_trace_assumes_no_size_of_a_count_nor_a_bandwidth(path: Path) -> None:
    lsb, band, latency = runs._figures(reader.read(path).info)
    assert (lsb, band) == (None, None)
    assert not latency.any()
