import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers import traces

from filters.effects.records import Included, State
from filters.tracing.result import Trace
from imutui.logbook import SessionInfo, atomic_file, effects_file

GOOD = """\
version = 1
source = "trace of two runs"
correlation = [[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]

[[effect]]
effect = "thermal_lin"
channels = ["gy"]
include_as = "A"
[effect.parameters]
t0_degc = 25.0
[[effect.state]]
name = "k"
unit = "dps/K"
mean = 0.02
sd = 0.001

[[effect]]
effect = "gauss_markov"
channels = ["gz", "ax"]
include_as = "S"
[[effect.state]]
name = "x"
unit = "dps"
mean = 0
sd = 0.02
tau_s = 60.0
q = 0.001
[[effect.state]]
name = "y"
unit = "mg"
mean = 0.0
sd = 0.3
tau_s = inf
q = 0.0

[[effect]]
effect = "noise_level"
channels = ["gx"]
include_as = "N"
"""


def test_an_effects_file_is_read_as_it_stands() -> None:
    document = effects_file.parse(GOOD.encode())
    assert document.source == "trace of two runs"
    assert [entry.effect for entry in document.effects] == ["thermal_lin", "gauss_markov", "noise_level"]
    assert document.effects[0].parameters == {"t0_degc": 25.0}
    assert document.effects[1].channels == ("gz", "ax")
    assert [(state.tau_s, state.q) for state in document.states] == [(math.inf, 0.0), (60.0, 0.001), (math.inf, 0.0)]
    assert np.allclose(np.sqrt(np.diag(document.covariance())), [0.001, 0.02, 0.3])
    assert document.covariance()[0, 1] == pytest.approx(0.5 * 0.001 * 0.02)
    # without a correlation the states are independent
    alone = effects_file.parse(GOOD.replace(GOOD.splitlines()[2], "").encode())
    assert np.array_equal(alone.correlation, np.eye(3))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("version = 1", "version = 2", "its version is 2, not 1. `imutui trace LOG... -o effects.toml` makes it anew"),
        ("version = 1", "", "it states no version"),
        ("version = 1", "version 1", "this is not"),
        ("source =", "sources =", "`sources` is unknown; did you mean `source`"),
        ('channels = ["gy"]', 'channels = ["wy"]', "effect 1: item 1 of `channels` is 'wy', not one of: gx"),
        ('include_as = "S"', 'include_as = "X"', "effect 2: `include_as` is .*not one of: A, N, S, P"),
        ('effect = "gauss_markov"', "", "effect 2: `effect` is missing"),
        ("mean = 0.02", 'mean = "much"', "effect 1, state 1: `mean` is 'much', not a finite number"),
        ("mean = 0.02", "mean = nan", "`mean` is nan"),
        ("mean = 0.02", "", "`mean` is missing"),
        ("sd = 0.02", "sd = -0.02", "effect 2, state 1: `sd` is -0.02"),
        ("tau_s = 60.0", "tau_s = 0.0", "`tau_s` is 0.0, not a finite number above 0"),
        ("q = 0.001", "q = inf", "`q` is inf"),
        ("q = 0.001", "Q = 0.001", "effect 2, state 1: `Q` is unknown; known: name, unit, mean, sd, tau_s, q"),
        (", [0.0, 0.0, 1.0]]", "]", "`correlation` has 2 rows, not 3"),
        ("[[1.0, 0.5, 0.0]", "[[1.0, 0.5]", "not a table of 3 by 3 numbers"),
        ("[[1.0, 0.5", "[[1.0, 0.4", "not symmetric"),
        ("0.5", "1.5", "negative eigenvalue"),
    ],
)
def test_what_is_no_effects_file_is_refused_with_the_place(old: str, new: str, words: str) -> None:
    assert old in GOOD
    with pytest.raises(ValueError, match=words):
        effects_file.parse(GOOD.replace(old, new).encode())


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"nothing\.toml: No such file .*imutui trace"):
        effects_file.from_file(tmp_path / "nothing.toml")


def test_no_effects_need_no_catalogue() -> None:
    assert effects_file.maker(effects_file.NONE, SessionInfo()) is None
    assert effects_file.digest(effects_file.NONE) == ""
    assert SessionInfo().config_sha256() != SessionInfo(effects_sha256=effects_file.digest(b"x")).config_sha256()


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
