"""How accurate one integration step is: ours, compiled and to be read, and the paper's Runge-Kutta, against DOP853.

    python benchmarks/accuracy.py

One step from a known state with constant input, at 133, 20, 1 and 0.1 Hz. The reference is scipy's DOP853 at 1e-13 on
equations written here anew: (1) and (2) with a unit quaternion instead of (3), and constants of its own. "rule" cuts
the step as the filters do (0.2 rad of turn, 1 s); "one piece" does not. The yardstick is the process noise that the
filter adds in one step by Table 1: an error well below it does no harm.
"""

import os
from collections.abc import Callable

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import bench
import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from filters import attitude
from filters.compilation import cached_njit
from filters.imu import IMU400CD_200
from filters.kalman import layout, spkf_paper, strapdown
from filters.kalman.kernels import lanes, step
from filters.kalman.rows import nav_of, row_of
from filters.state import PAPER_SITE, NavState

RATES = (133.0, 20.0, 1.0, 0.1)
_DEG = np.pi / 180.0
GRAVITY = PAPER_SITE.gravity
LEVEL = np.array([0.0, 0.0, -GRAVITY])

CASES: dict[str, np.ndarray] = {
    "level, bias error 1 deg/s on each axis": np.array([1.0, 1.0, 1.0]) * _DEG,
    "200 deg/s about (1, 1, 1)": np.array([1.0, 1.0, 1.0]) / 3**0.5 * 200.0 * _DEG,
    "200 deg/s about y, from level": np.array([0.0, 200.0, 0.0]) * _DEG,
}
"""Angular rate that the unit reads, beside what it senses of the Earth at rest; its specific force is that at rest."""

State = tuple[np.ndarray, np.ndarray]  # attitude C_nb (3, 3) and velocity NED (3,), m/s


def reference(rate: np.ndarray, dt: float) -> State:
    """State after `dt` by DOP853."""
    a, e2, spin = 6378137.0, 6.69437999014e-3, 7.292115e-5

    def derivative(_: float, y: np.ndarray) -> np.ndarray:
        lat, height, (vn, ve, vd), q = y[0], y[2], y[3:6], y[6:]
        w = np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
        meridian, transverse = a * (1.0 - e2) / w**3 + height, a / w + height
        earth = spin * np.array([np.cos(lat), 0.0, -np.sin(lat)])
        transport = np.array([ve / transverse, -vn / meridian, -ve * np.tan(lat) / transverse])
        C = Rotation.from_quat(np.roll(q, -1) / np.linalg.norm(q)).as_matrix()
        v = np.array([vn, ve, vd])
        acceleration = C @ LEVEL + [0.0, 0.0, GRAVITY] - np.cross(2.0 * earth + transport, v)
        w_nb = rate - C.T @ (earth + transport)
        turning = 0.5 * np.concatenate([[-q[1:] @ w_nb], q[0] * w_nb + np.cross(q[1:], w_nb)])
        return np.concatenate([[vn / meridian, ve / (transverse * np.cos(lat)), -vd], acceleration, turning])

    first = np.array([PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height, 0, 0, 0, 1, 0, 0, 0], float)
    result = solve_ivp(derivative, (0.0, dt), first, method="DOP853", rtol=1e-13, atol=1e-15)
    assert result.success, result.message
    y = result.y[:, -1]
    return Rotation.from_quat(np.roll(y[6:], -1)).as_matrix(), y[3:6]


def _level() -> NavState:
    return NavState.at_rest(PAPER_SITE, np.eye(3))


def readable(rate: np.ndarray, dt: float) -> State:
    """`strapdown.propagate`, with the rule."""
    nav = strapdown.propagate(_level(), rate, LEVEL, dt, GRAVITY)
    return nav.C_nb, nav.velocity_n


def readable_whole(rate: np.ndarray, dt: float) -> State:
    """The same in one piece."""
    nav = strapdown._substep(_level(), [rate] * 3, [LEVEL] * 3, dt, GRAVITY)
    return nav.C_nb, nav.velocity_n


@cached_njit
def _predicted(core, P, par, dt, work):  # type: ignore[no-untyped-def]
    return lanes.predict(core, P, par, dt, 1.0, 0.0, work)


def compiled(rate: np.ndarray, dt: float) -> State:
    """The compiled prediction, with the rule, of a belief so narrow that its mean is its centre."""
    core, par = np.zeros(layout.CORE), np.zeros(layout.PAR)
    core[: layout.NAV] = row_of(_level())
    P = np.zeros((15, layout.STRIDE))
    np.fill_diagonal(P, 1e-30)
    work = step.make_work()
    work.gyro[:], work.accel[:] = np.tile(rate, 2), np.tile(LEVEL, 2)
    failed = _predicted(core, P.ravel(), par, dt, work)
    assert failed < 0
    nav = nav_of(core)
    return nav.C_nb, nav.velocity_n


def paper(rate: np.ndarray, dt: float) -> State:
    """`spkf_paper.integrate`: Euler angles, Runge-Kutta of order four, with the rule."""
    x = np.zeros(15)
    x[:3] = PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height
    x = spkf_paper.integrate(x, rate, LEVEL, dt, GRAVITY)
    return attitude.from_rpy(x[6], x[7], x[8]), x[3:6]


def paper_whole(rate: np.ndarray, dt: float) -> State:
    """The same in one piece, which is (13) to the letter."""
    x = np.zeros(15)
    x[:3] = PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height

    def f(at: np.ndarray) -> np.ndarray:
        return spkf_paper.derivative(at, rate, LEVEL, GRAVITY)

    k1 = f(x)
    k2 = f(x + 0.5 * dt * k1)
    k3 = f(x + 0.5 * dt * k2)
    k4 = f(x + dt * k3)
    x = x + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return attitude.from_rpy(x[6], x[7], x[8]), x[3:6]


SIDES: dict[str, Callable[[np.ndarray, float], State]] = {
    "strapdown, rule": readable,
    "compiled, rule": compiled,
    "RK4 of (1)-(5), rule": paper,
    "strapdown, one piece": readable_whole,
    "RK4, one piece": paper_whole,
}


def main() -> None:
    bench.options(__doc__)
    print(bench.describe("numpy", "scipy", "numba"))
    print("\nAttitude error deg / velocity error m/s of one step\n")
    print(f"| case | Hz | {' | '.join(SIDES)} | noise of a step |")
    print(f"| --- | ---: |{' --- |' * (len(SIDES) + 1)}")
    for case, rate in CASES.items():
        sensed = rate + _at_rest()
        for hz in RATES:
            print(f"| {case} | {hz:g} | {' | '.join(_cells(sensed, 1.0 / hz))} |", flush=True)


def _at_rest() -> np.ndarray:
    """The Earth's rate, which a level unit senses."""
    phi = PAPER_SITE.latitude
    return 7.292115e-5 * np.array([np.cos(phi), 0.0, -np.sin(phi)])


def _cells(rate: np.ndarray, dt: float) -> list[str]:
    C_true, v_true = reference(rate, dt)
    cells = []
    for side in SIDES.values():
        C, v = side(rate, dt)
        angle = float(np.linalg.norm(attitude.log(C @ C_true.T))) / _DEG
        cells.append(f"{angle:.1e} / {np.linalg.norm(v - v_true):.1e}")
    spec = IMU400CD_200
    noise = f"{spec.gyro_arw / _DEG * dt**0.5:.1e} / {spec.accel_vrw * dt**0.5:.1e}"
    return [*cells, noise]


if __name__ == "__main__":
    main()
