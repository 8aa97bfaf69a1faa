"""The float64 reference is the textbook: it meets closed forms that were not used to write it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb.kernels.reference import kernels as reference_kernels
from plumb.kernels.reference.blending import complementary_step, weighted_average
from plumb.spec.tuning import Kalman, Start

PERIOD_S = 0.02
PAPER = Kalman(0.5, 0.25)  # Q = diag(0.01, 0.005) per step of 20 ms
PAPER_R = 0.056


def steady_gains(settings: Kalman, period_s: float, r: float) -> tuple[float, float]:
    """Gains of the stationary filter, from the scalar condition the Riccati equation reduces to.

    With S = R / (1 - k0) and L = Ts |k1| = Ts sqrt(q_b / S):  k0^2 = L (2 - k0) + q_a / S.
    """
    qa, qb = settings.q_angle_deg2_per_s * period_s, settings.q_bias_dps2_per_s * period_s
    low, high = 0.0, 1.0
    for _ in range(200):
        k0 = (low + high) / 2
        s = r / (1 - k0)
        lag = period_s * math.sqrt(qb / s)
        low, high = (k0, high) if k0 * k0 < lag * (2 - k0) + qa / s else (low, k0)
    return k0, -lag / period_s


@pytest.mark.parametrize("r", [0.056, 1.0, 30.0])
@pytest.mark.parametrize("period_s", [0.02, 0.0005, 0.1])
def test_gain_settles_at_the_riccati_solution(period_s: float, r: float) -> None:
    x = reference_kernels.kalman_init(Start())
    for _ in range(int(40 / period_s)):
        reference_kernels.kalman_step(x, PAPER, period_s, 0.0, 0.0, r)
    # The slowest mode of these filters lasts 1.3 to 2.3 s: of a start 40 s ago e^-17 = 4e-8 is left.
    assert (x.k0, x.k1) == pytest.approx(steady_gains(PAPER, period_s, r), rel=1e-7)


def test_one_step_is_the_printed_matrices() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        ts, qa, qb, r = rng.uniform(0.0005, 0.1), *rng.uniform(0.001, 5, 3)
        z, u = rng.uniform(-30, 30), rng.uniform(-200, 200)
        root = rng.normal(size=(2, 2))
        P, X = root @ root.T, rng.uniform(-3, 3, (2, 1))
        A, B, H = np.array([[1, -ts], [0, 1]]), np.array([[ts], [0]]), np.array([[1.0, 0.0]])
        x = reference_kernels.KalmanState(X[0, 0], X[1, 0], P[0, 0], P[0, 1], P[1, 0], P[1, 1])
        reference_kernels.kalman_step(x, Kalman(qa / ts, qb / ts, "current"), ts, z, u, r)

        X = A @ X + B * u  # (1)
        P = A @ P @ A.T + np.diag([qa, qb])  # (2)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + r)  # (4)
        X = X + K @ (z - H @ X)  # (3)
        P = (np.eye(2) - K @ H) @ P  # (5)
        assert [x.tilt_deg, x.bias_dps] == pytest.approx(X.ravel(), rel=1e-12, abs=1e-12)
        assert [x.p00, x.p01, x.p10, x.p11] == pytest.approx(P.ravel(), rel=1e-9, abs=1e-12)


def test_without_process_noise_it_is_a_line_fit() -> None:
    """Q = 0 and a start that knows nothing: tilt and bias are the least-squares line through z."""
    rng = np.random.default_rng(2)
    z = rng.normal(0, 0.5, 60)
    x = reference_kernels.kalman_init(Start(p00_deg2=1e7, p11_dps2=1e7))
    for sample in z:
        reference_kernels.kalman_step(x, Kalman(0.0, 0.0), PERIOD_S, sample, 0.0, 0.25)
    slope, offset = np.polyfit(np.arange(60) * PERIOD_S, z, 1)
    # The start is not quite without knowledge: it weighs R / P0 = 2.5e-8 of a sample, and P falls from 1e7 with
    # rounding.
    assert x.tilt_deg == pytest.approx(offset + slope * 59 * PERIOD_S, abs=1e-5)
    assert -x.bias_dps == pytest.approx(slope, abs=1e-5)


def test_bias_and_tilt_converge_at_rest() -> None:
    x = reference_kernels.kalman_init(Start(p00_deg2=900, p11_dps2=25))
    for _ in range(3000):
        reference_kernels.kalman_step(x, PAPER, PERIOD_S, 12.0, 20.0, PAPER_R)
    # 60 s are 43 times the slowest mode's 1.4 s: nothing but rounding is left of the start.
    assert (x.tilt_deg, x.bias_dps) == pytest.approx((12.0, 20.0), abs=1e-9)


def test_previous_gyro_sample_is_the_input() -> None:
    x = reference_kernels.kalman_init(Start(p00_deg2=0, p11_dps2=0))
    tilts = []
    for rate_dps in (10.0, 50.0, 0.0):  # the first step has no previous sample and takes its own
        reference_kernels.kalman_step(x, Kalman(0, 0, "previous"), PERIOD_S, 0.0, rate_dps, 1.0)
        tilts.append(x.tilt_deg / PERIOD_S)
    assert tilts == pytest.approx([10.0, 20.0, 70.0])


def test_innovation_takes_the_short_way_round() -> None:
    x = reference_kernels.kalman_init(Start(tilt_deg=179.0))
    reference_kernels.kalman_step(x, PAPER, PERIOD_S, -179.0, 0.0, PAPER_R)
    assert x.innovation_deg == pytest.approx(2.0)
    assert -180.0 <= x.tilt_deg < -178.9


@pytest.mark.parametrize(
    ("y", "z", "deg"), [(0, 1, 0), (1, 0, 90), (0, -1, 180), (-1, 0, -90), (1, 1, 45), (-1, -1, -135)]
)
def test_tilt_by_two_axes(y: float, z: float, deg: float) -> None:
    assert reference_kernels.tilt(y, z, "atan2") == pytest.approx(deg)


@pytest.mark.parametrize(("y", "deg"), [(0, 0), (0.5, 30), (-0.5, -30), (1, 90), (1.2, 90), (-1.2, -90)])
def test_tilt_by_arcsine(y: float, deg: float) -> None:
    assert reference_kernels.tilt(y, 123.0, "arcsine") == pytest.approx(deg)


def test_a_complementary_filter_forgets_its_start_and_keeps_bias_times_tau() -> None:
    """In time tau 1/e of a wrong start is left; a gyro bias b leaves b tau for good."""
    period_s, tau_s, bias_dps = 0.001, 0.5, 2.0
    wrong, biased = 10.0, 0.0
    for _ in range(round(tau_s / period_s)):
        wrong = complementary_step(wrong, 0.0, 0.0, period_s, tau_s)
    # In steps the share left is (1 + Ts / tau)^(-tau / Ts), greater by Ts / (2 tau) = 1e-3 of itself.
    assert wrong == pytest.approx(10.0 * np.exp(-1.0), rel=2e-3)
    for _ in range(round(20.0 * tau_s / period_s)):
        biased = complementary_step(biased, bias_dps, 0.0, period_s, tau_s)
    # Of the start e^-20 = 2e-9 is left.
    assert biased == pytest.approx(bias_dps * tau_s, rel=1e-6)
    assert abs(complementary_step(179.9, 0.0, -179.9, period_s, tau_s)) > 179.8, "the short way around"


def test_a_weighted_average_goes_the_short_way_around() -> None:
    assert weighted_average(20.0, 10.0, 0.25) == pytest.approx(12.5)
    assert weighted_average(-179.0, 179.0, 0.5) == pytest.approx(-180.0)
    assert weighted_average(30.0, 10.0, 0.0) == 10.0 and weighted_average(30.0, 10.0, 1.0) == 30.0
