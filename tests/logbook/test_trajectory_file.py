import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from filters.errors import InputError
from imutui.logbook import trajectory_file
from imutui.logbook.trajectory_file import Trajectory

HEADER = "t,lat,lon,h,vn,ve,vd,roll,pitch,yaw\n"


def cell(low: float, high: float) -> st.SearchStrategy[float]:
    return st.one_of(st.just(np.nan), st.floats(low, high))


rows = st.tuples(
    cell(-90, 90),
    cell(-180, 360),
    cell(-1e3, 1e5),
    *[cell(-300, 300)] * 3,
    cell(-180, 180),
    cell(-90, 90),
    cell(-180, 180),
)


@given(st.lists(rows, min_size=1, max_size=5))
def test_a_trajectory_survives_as_text(table: list[tuple[float, ...]]) -> None:
    degrees = np.array(table)
    values = degrees * np.where(np.isin(np.arange(9), [0, 1, 6, 7, 8]), np.pi / 180.0, 1.0)
    text = trajectory_file.format(Trajectory(np.arange(len(table)) / 7.0, values))
    read = trajectory_file.parse(text, "a.csv")
    assert np.allclose(read.t, np.arange(len(table)) / 7.0, atol=1e-9)
    assert np.allclose(read.values, values, rtol=0.0, atol=1e-5, equal_nan=True)
    assert np.allclose(read.values[:, :2], values[:, :2], rtol=0.0, atol=1e-12, equal_nan=True)
    assert trajectory_file.format(read) == text


def test_columns_may_stand_in_any_order_and_attitude_may_be_absent() -> None:
    read = trajectory_file.parse("h, lat,lon,vn,ve,vd,t\n641,-23,-45,,,,0\n\n,,,1,2,3,0.5\n", "a.csv")
    assert read.t.tolist() == [0.0, 0.5]
    assert np.allclose(read.values[0, :3], [np.deg2rad(-23), np.deg2rad(-45), 641])
    assert read.values[1, 3:6].tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(read.values[:, 6:]).all()
    assert np.isnan(read.values[0, 3:]).all()


BAD = {
    "": ("is empty", "lat"),
    "t,lat,lon,h,vn,ve\n0,,,,,\n": ("line 1", "`vd`"),
    HEADER.replace("yaw", "heading"): ("line 1", '"heading"'),
    HEADER.replace("yaw", "roll"): ("line 1", "`roll`", "twice"),
    HEADER: ("no rows",),
    HEADER + "0,,,,,,,,,\n1,,,x,,,,,,\n": ("line 3", "`h`", '"x"'),
    HEADER + "0,,,,,,,,,\n\n1,,,inf,,,,,,\n": ("line 4", "`h`", '"inf"'),
    HEADER + ",,,,,,,,,\n": ("line 2", "`t`"),
    HEADER + "0,,,,,,,,,\n1,,,,,,,,\n": ("line 3", "9 cells"),
    HEADER + "0,,,,,,,,,\n0,,,,,,,,,\n": ("line 3", "`t`", "not increase"),
    HEADER + "0,90.1,,,,,,,,\n": ("line 2", "`lat`", "90.1", "-90 to 90"),
    HEADER + "0,,,,,,,,91,\n": ("line 2", "`pitch`", "91"),
}


@pytest.mark.parametrize("text", BAD)
def test_a_text_that_is_no_trajectory_is_named_with_line_and_column(text: str) -> None:
    with pytest.raises(InputError) as caught:
        trajectory_file.parse(text, "path.csv")
    assert all(word in str(caught.value) for word in ("path.csv", *BAD[text])), caught.value
