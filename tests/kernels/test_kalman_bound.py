"""The integers against float64: 2e-5 deg with the paper's constants, 5e-4 with the other shipped tunings.

Over the whole turn, 20 deg/s of bias and 10^6 steps, in `make test` a fifth of them; the stated bound for every other
set; and the chain from counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.contract import run_reference
from plumb.contract.parameters import ControlParams, quantise
from plumb.kernels.fixed import kernels as fixed_kernels
from plumb.kernels.reference import kernels as reference_kernels
from plumb.proof import accuracy
from plumb.spec.tuning import Kalman, Pid, Start, Trust
from plumb.systems.quad import scenarios as quad
from support.campaigns import campaign
from support.tuning_box import CORNERS, corner

STEPS = campaign(200_000, 1_000_000)
FILTERS = {(tuning.kalman, tuning.trust, tuning.start, tuning.period_us): name for name, tuning in quad.TUNINGS.items()}
"""Shipped tunings that differ in the filter; one of each."""


def budget_deg(name: str) -> float:
    return 2e-5 if name.startswith("paper") else 5e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", FILTERS.values())
def test_shipped_tunings_keep_their_budget_over_many_steps(name: str) -> None:
    params = quantise(quad.TUNINGS[name])
    inputs = accuracy.hard_inputs(params, STEPS, seed=11)
    z_deg = inputs.tilt_turn_q32 * accuracy.TURN_DEG
    # The inputs are hard: they cross the half turn, and R takes nearly all of its range of a thousand.
    assert z_deg.min() < -179.9 and z_deg.max() > 179.9
    if params["tilt.r_max"] > params["tilt.r_base"]:
        assert inputs.variance.max() > 900 * inputs.variance.min()
    error = accuracy.filter_error_deg(params, inputs)
    assert np.abs(error).max() <= budget_deg(name)
    blocks = error.reshape(100, -1).mean(axis=1)
    assert abs(error.mean()) <= 4.0 * blocks.std() / np.sqrt(len(blocks)), "no bias: 4 standard errors of the mean"


@pytest.mark.parametrize("name", FILTERS.values())
def test_fixed_is_what_was_measured(name: str) -> None:
    """The bound above is measured on the C; fixed is the same to the bit on that input."""
    params = quantise(quad.TUNINGS[name])
    inputs = accuracy.hard_inputs(params, 20_000, seed=11)
    fused, _ = native_core.kalman_run(params, inputs.variance, inputs.tilt_turn_q32, inputs.rate_turnps_q28)
    k = fixed_kernels.kalman_init(params.values)
    rows = zip(inputs.variance.tolist(), inputs.tilt_turn_q32.tolist(), inputs.rate_turnps_q28.tolist(), strict=True)
    for expected, (r, z, u) in zip(fused.tolist(), rows, strict=True):
        fixed_kernels.kalman_step(k, params.values, r, z, u)
        assert ((k.tilt_turn_q61 >> 29) + 2**31) % 2**32 - 2**31 == expected


def worst_share_of_bound(params: ControlParams, steps: int) -> float:
    bound_deg = accuracy.filter_bound_deg(params)
    inputs = accuracy.hard_inputs(params, steps, seed=12)
    near_deg = min(max(bound_deg, accuracy.NEAR_HALF_TURN_DEG), 90.0)
    return float(np.abs(accuracy.filter_error_deg(params, inputs, near_deg)).max()) / bound_deg


@pytest.mark.slow
@pytest.mark.parametrize("r", [1e-3, 1e3])
@pytest.mark.parametrize("period_us", [500, 100_000])
def test_corners_of_the_box_keep_the_stated_bound(period_us: int, r: float) -> None:
    for box in CORNERS:
        if box[0] == period_us and box[3] == r:
            assert worst_share_of_bound(quantise(corner(int(box[0]), *box[1:])), 15_000) <= 1.0, box


def test_the_inside_of_the_box_keeps_the_stated_bound() -> None:
    rng = np.random.default_rng(13)
    low, high = np.log([500, 1e-6, 1e-8, 1e-3, 1e-3, 1e-3]), np.log([1e5, 10.0, 1.0, 1e3, 180.0**2, 500.0**2])
    for _ in range(40):
        period, q_angle, q_bias, r, p00, p11 = np.exp(rng.uniform(low, high)).tolist()
        trust = Trust(r) if rng.random() < 0.5 else Trust(r, 1000.0 * r, min(1000.0 * r, 1e6))
        tuning = replace(
            quad.TUNINGS["paper"],
            period_us=int(period),
            kalman=Kalman(q_angle, q_bias),
            trust=trust,
            start=Start(p00_deg2=p00, p11_dps2=p11),
            pid=Pid(),
        )
        assert worst_share_of_bound(quantise(tuning), 30_000) <= 1.0, tuning


@pytest.mark.parametrize("name", quad.TUNINGS)
def test_the_whole_chain_from_counts(name: str) -> None:
    """Counts to angle, every rounding of calibration, tilt and trust included; and on to the pulses."""
    params = quantise(quad.TUNINGS[name])
    for scenario in ("motion", "disturb", "converge"):
        run = quad.scenario(scenario, 1003)
        words = native_core.run_control(params, run.counts(), run.setpoint())
        truth = run_reference.run_control(params, run.counts(), run.setpoint())
        tilt_deg = words["tilt_turn_q32"] * accuracy.TURN_DEG
        error_deg = float(np.abs(reference_kernels.wrap(tilt_deg - truth["tilt_deg"])).max())
        assert error_deg <= min(5e-4, accuracy.chain_bound_deg(params, float(np.abs(truth["innovation_deg"]).max())))
        # A count of the gyro is 1.2 deg/s: the bias is within a five-hundredth of it; a pulse is within its unit.
        assert np.abs(words["bias_turnps_q28"] * 360 / 2**28 - truth["bias_dps"]).max() <= 2e-3
        assert np.abs(words["pulse_halfus_0"] / 2 - truth["pulse_0_us"]).max() <= 0.5
