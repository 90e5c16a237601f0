"""The effects file: valid TOML that says exactly what was found."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers import traces

from filters.effects.records import Included, State
from filters.tracing.result import Trace
from imutui.logbook import atomic_file, effects_file


def test_every_number_comes_back_as_it_was() -> None:
    made = traces.trace()
    read = tomllib.loads(effects_file.dumps(made, 'trace of "a".mcap'))
    assert read["version"] == 1
    assert read["source"] == 'trace of "a".mcap'
    assert read["correlation"] == made.correlation.tolist()
    assert [effect["effect"] for effect in read["effect"]] == ["thermal_lin", "gauss_markov"]
    for effect, given in zip(read["effect"], made.included, strict=True):
        assert effect["channels"] == list(given.channels)
        assert effect["include_as"] == given.include_as
        assert effect.get("parameters", {}) == given.parameters
        assert [State(**state) for state in effect["state"]] == list(given.states)
    assert read["effect"][0]["state"][0]["tau_s"] == np.inf


def test_parameters_of_any_kind_are_written() -> None:
    parameters = {
        "knots": np.linspace(0.0, 1.0, 3),
        "order": 2,
        "on": True,
        "basis": 'h"a\nt',
        "of time": {"a": 1.0, "b": None},
        "none": None,
        "n": np.int64(3),
    }
    made = Trace({}, (Included("driver:wx*fy", ("gx",), "A", parameters),), np.empty((0, 0)), ())
    read = tomllib.loads(effects_file.dumps(made, "x"))["effect"][0]
    assert read["parameters"] == {
        "knots": [0.0, 0.5, 1.0], "order": 2, "on": True, "basis": 'h"a\nt', "of time": {"a": 1.0}, "n": 3,
    }  # fmt: skip
    assert "state" not in read


def test_nothing_included_is_a_valid_file() -> None:
    text = effects_file.dumps(traces.nothing(), "trace of a.mcap")
    assert effects_file.parse(text.encode()).effects == ()
    read = tomllib.loads(text)
    assert read == {"version": 1, "source": "trace of a.mcap", "correlation": []}


def test_a_file_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "effects.toml"
    atomic_file.write(path, "a = 1\n", overwrite=False)
    with pytest.raises(FileExistsError):
        atomic_file.write(path, "a = 2\n", overwrite=False)
    assert path.read_text() == "a = 1\n"
    atomic_file.write(path, "a = 2\n", overwrite=True)
    assert path.read_text() == "a = 2\n"
    assert list(tmp_path.iterdir()) == [path]
