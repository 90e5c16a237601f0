import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from filters import attitude

vectors = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)
angles = st.floats(-np.pi, np.pi)


@given(vectors)
def test_log_undoes_exp(v: np.ndarray) -> None:
    v = v if np.linalg.norm(v) < np.pi else v / np.linalg.norm(v) * 3.1
    assert np.allclose(attitude.log(attitude.exp(v)), v, atol=1e-9)


@given(vectors)
def test_exp_agrees_with_scipy(v: np.ndarray) -> None:
    assert np.allclose(attitude.exp(v), Rotation.from_rotvec(v).as_matrix(), atol=1e-14)


def test_log_keeps_its_digits_near_zero_and_near_a_half_turn() -> None:
    tiny = np.array([1e-9, -2e-9, 3e-9])
    assert np.allclose(attitude.log(attitude.exp(tiny)), tiny, atol=1e-15)
    far = np.array([0.6, 0.0, -0.8]) * (np.pi - 1e-6)
    assert np.allclose(attitude.log(attitude.exp(far)), far, atol=1e-9)


def test_exp_takes_many_at_once() -> None:
    v = np.random.default_rng(1).normal(size=(4, 5, 3))
    C = attitude.exp(v)
    assert C.shape == (4, 5, 3, 3)
    assert np.array_equal(C[2, 3], attitude.exp(v[2, 3]))
    assert np.allclose(
        attitude.log(C),
        v
        * (1 - 2 * np.pi * np.floor((np.linalg.norm(v, axis=-1) + np.pi) / (2 * np.pi)) / np.linalg.norm(v, axis=-1))[
            ..., None
        ],
    )


@given(angles, st.floats(-1.5, 1.5), angles)
def test_roll_pitch_yaw_round_trip(roll: float, pitch: float, yaw: float) -> None:
    rpy = attitude.to_rpy(attitude.from_rpy(roll, pitch, yaw))
    assert np.allclose(np.exp(1j * rpy), np.exp(1j * np.array([roll, pitch, yaw])), atol=1e-9)


def test_rpy_jacobian_is_the_derivative() -> None:
    C = attitude.from_rpy(0.3, -0.5, 1.2)
    h = 1e-6
    numeric = [
        (attitude.to_rpy(attitude.exp(h * e) @ C) - attitude.to_rpy(attitude.exp(-h * e) @ C)) / (2 * h)
        for e in np.eye(3)
    ]
    assert np.allclose(attitude.rpy_jacobian(C), np.transpose(numeric), atol=1e-8)
