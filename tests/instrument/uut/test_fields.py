"""Configuration fields: orientations, rates, speeds and filters as the documents list them."""

import numpy as np
import pytest
from helpers.units import IMU380ZA_200

from imutui.instrument.uut.fields import (
    ORIENTATIONS,
    RATE_OF_DIVIDER,
    RATE_OF_DIVIDER_LATER,
    fits_line,
    in_words,
)
from imutui.instrument.uut.unit_options import FieldValues


def test_24_of_512_orientations_are_legal() -> None:
    assert len(ORIENTATIONS) == len({(it.axes, it.signs) for it in ORIENTATIONS.values()}) == 24
    assert max(ORIENTATIONS) < 512
    for value, it in ORIENTATIONS.items():
        matrix = np.zeros((3, 3))
        matrix[range(3), list(it.axes)] = it.signs
        assert np.linalg.det(matrix) == pytest.approx(1.0)
        assert it.field == value


@pytest.mark.parametrize(
    ("value", "text"),
    [(0x0000, "+Ux +Uy +Uz"), (0x006B, "-Uy -Ux -Uz"), (0x0009, "-Ux -Uy +Uz"), (0x0062, "+Uy +Ux -Uz")],
)
def test_orientations_read_as_in_the_guides(value: int, text: str) -> None:
    assert ORIENTATIONS[value].text == text


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (
            IMU380ZA_200,
            "divider 1 (100 Hz), 38400 baud, packets S1, field 5 5000, field 6 5000, orientation 0x006b (",
        ),
        (((1, 0), (2, 9), (3, 0x5330)), "rate divider 0 (quiet), baud rate field 9, packets S0"),
        (((1, 3), (3, 0), (7, 0xFFFF)), "divider 3, packets 0x0000, orientation 0xffff (which is none of the 24)"),
        ((), ""),
    ],
)
def test_fields_are_told_in_words(values: FieldValues, text: str) -> None:
    assert text in in_words(dict(values))


def test_rates_are_a_hundred_by_the_divider() -> None:
    """But for two that later firmware has."""
    assert all(divider * hz == 100 for divider, hz in RATE_OF_DIVIDER.items())
    assert set(RATE_OF_DIVIDER_LATER.items()) - set(RATE_OF_DIVIDER.items()) == {(200, 200), (100, 1)}


def test_a_rate_has_to_fit_the_line() -> None:
    """S1 at 100 Hz just fits 38400 baud; S0 needs 57600, and 200 Hz need 115200."""
    assert fits_line(100, 24, 38400)
    assert not fits_line(100, 24, 19200)
    assert not fits_line(100, 30, 38400)
    assert fits_line(100, 30, 57600)
    assert not fits_line(200, 24, 57600)
    assert fits_line(200, 24, 115200)
