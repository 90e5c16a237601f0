from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers import ros_messages

from filters.errors import InputError
from filters.kalman import runner
from filters.kalman.runner import Estimator
from filters.motion import reference
from filters.motion.profile import Profile
from filters.motion.segments import Dwell
from filters.state import PAPER_SITE
from imutui.logbook import reader, schemas
from imutui.logbook.samples import Samples
from imutui.logbook.session_info import SessionInfo
from imutui.session import live_filter, metadata
from imutui.session.live_filter import LiveFilter
from imutui.session.plan import Plan

FIRST_NS = 1_790_000_000_000_000_000
GYRO = 'align = "gyro"\n[[segment]]\nkind = "dwell"\nangles_deg = [0.0, 0.0, 0.0]\nseconds = 9.0\n'
RATE, FORCE = reference.level(PAPER_SITE).rates_and_forces()


def samples(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return RATE + rng.normal(size=(n, 3)) * 5e-3, FORCE + rng.normal(size=(n, 3)) * 0.07


def fed(live: LiveFilter, stamp_ns: int, gyro: np.ndarray, accel: np.ndarray) -> Iterator[tuple[int, bytes]]:
    """What a sample of unknown temperature gives."""
    return live.samples(Samples(np.array([stamp_ns]), gyro[None], accel[None], np.ones(1, bool), np.array([np.nan])))


def prepared() -> None:
    """Have the filter's step ready before the first sample."""
    live_filter.PLAIN.begin()
    assert live_filter.PLAIN.ready.wait(120.0)


def test_samples_wait_while_the_step_is_compiled_and_then_all_count() -> None:
    session = SessionInfo(rate_hz=20.0)
    prepared()
    live = LiveFilter(session)
    gyro, accel = samples(200)
    stamps = [FIRST_NS + k * 50_000_000 for k in range(200)]
    live_filter.PLAIN.ready.clear()
    try:
        for k in range(100):
            assert list(fed(live, stamps[k], gyro[k], accel[k])) == []
        assert live.waiting == 100
    finally:
        live_filter.PLAIN.ready.set()
    written = [m for k in range(100, 200) for m in fed(live, stamps[k], gyro[k], accel[k])]
    written += list(live.finish())
    replayed = Estimator(session.settings(), every=live_filter.ESTIMATE_PERIOD_S)
    estimates = list(runner.run(replayed, reader.seconds_since(np.array(stamps), FIRST_NS), gyro, accel))
    assert [stamp for stamp, _ in written] == [FIRST_NS + round(e.t * 1e9) for e in estimates]
    last = ros_messages.decode(schemas.TYPES[schemas.ESTIMATE], written[-1][1])
    assert np.array_equal(last.velocity_mps, estimates[-1].belief.nav.velocity_n)
    assert last.nis == estimates[-1].nis


def test_who_is_told_to_go_waits_for_no_compiler_and_says_what_is_left_out() -> None:
    prepared()
    live = LiveFilter(SessionInfo(rate_hz=20.0))
    gyro, accel = samples(30)
    live_filter.PLAIN.ready.clear()
    try:
        for k in range(30):
            assert list(fed(live, FIRST_NS + k * 50_000_000, gyro[k], accel[k])) == []
        live.leave_out_unless_ready(0.01)
        assert live.failure is not None
        assert "imutui replay" in live.failure
        assert list(live.finish()) == []
    finally:
        live_filter.PLAIN.ready.set()
    other = LiveFilter(SessionInfo(rate_hz=20.0))
    list(fed(other, FIRST_NS, gyro[0], accel[0]))
    other.leave_out_unless_ready(0.01)
    assert other.failure is None


def test_marks_before_the_first_sample_count_as_they_do_in_a_replay() -> None:
    """A mark 0.2 s early begins the first dwell, whose rows are used from 2 s after it."""
    profile = Profile((Dwell((0.0, 0.0, 0.0), 60.0),), align="marks")
    prepared()
    live = LiveFilter(SessionInfo(rate_hz=20.0, reference="profile"), profile)
    live.mark(FIRST_NS - 200_000_000, "level")
    gyro, accel = samples(60)
    dofs = []
    for k in range(60):
        for _, message in fed(live, FIRST_NS + k * 50_000_000, gyro[k], accel[k]):
            dofs.append(ros_messages.decode(schemas.TYPES[schemas.ESTIMATE], message).nis_dof)
    list(live.finish())
    assert dofs[:18] == [0] * 18  # 10 estimates a second, up to 1.8 s
    assert dofs[-1] == 9


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"noise": "log"}, "whole log"),
        ({"reference": "profile", "reference_file": ("t.toml", GYRO)}, "align by"),
        ({"reference": "profile"}, "motion"),
    ],
)
def test_what_a_filter_cannot_do_live_is_refused_with_the_reason(fields: dict[str, object], words: str) -> None:
    plan = Plan("virtual", **fields)  # type: ignore[arg-type]
    session = SessionInfo(noise=plan.noise, reference=plan.reference)
    with pytest.raises(ValueError, match=words):
        metadata.check_live(session, metadata.motion_of(plan))


@pytest.mark.parametrize("kind", [InputError, ValueError])
def test_a_filter_that_stops_says_whether_that_is_a_defect(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: type
) -> None:
    """Nothing is raised here: the recorder raises a fault of ours, once the file has the packets."""

    def rows(*_: object, **__: object) -> None:
        raise kind("time must increase")

    prepared()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(runner, "rows", rows)
    live = LiveFilter(SessionInfo(rate_hz=20.0))
    gyro, accel = samples(1)
    assert list(fed(live, FIRST_NS, gyro[0], accel[0])) == []
    assert live.failure is not None
    assert live.failure.startswith("the filter stopped")
    assert ("a defect of imutui" in live.failure) == (kind is ValueError) == isinstance(live.defect, ValueError)


def test_a_cause_is_told_with_its_fields_for_programs_and_withdrawn_when_it_has_gone() -> None:
    prepared()
    live = LiveFilter(SessionInfo(rate_hz=20.0))
    gyro, accel = samples(6400)
    gyro[:3000, 1] += 5e-3 * np.sin(2.0 * np.pi * 0.5 * np.arange(3000) / 20.0)
    said = []
    for k in range(6400):
        list(fed(live, FIRST_NS + k * 50_000_000, gyro[k], accel[k]))
        said += live.news()
    (told, text), (gone, last) = said
    assert (told, gone) == ("cause", "cause_gone")
    assert text.startswith("gy oscillates at 0.5")
    fields = [dict(one.split("=") for one in words[words.rindex("(") + 1 : -1].split()) for words in (text, last)]
    assert [(one["channel"], one["effect"], one["unit"], one["since"]) for one in fields] == [
        ("gy", "tone", "deg/s", fields[0]["since"])
    ] * 2
    assert float(fields[0]["odds"]) >= 9.0 > 1.0 > float(fields[1]["odds"])
    assert abs(float(fields[0]["size"]) - np.rad2deg(5e-3)) < 4.0 * float(fields[0]["sd"])
