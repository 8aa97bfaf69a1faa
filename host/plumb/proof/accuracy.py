"""Accuracy of the arithmetic: distance of the integers from float64 on the same integer inputs.

`python -m plumb.proof.accuracy [--seeds N] [SYSTEM ...]` prints the table of docs/explanation/accuracy.md, for every
tuning. The inputs of the filter alone are extreme: the tilt sweeps through the whole turn, the gyro has 20 deg/s of
bias, one measurement in fifty is an outlier of any angle, and R jumps over its whole range if the tuning allows it. The
inputs of the chain are the system's default scenario, seed 1000, or the worst of N seeds from there on. Bounds are for
an innovation of 180 deg; the page has the bound of a chain of more than one filter.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards.native import core as native_core
from plumb.boards.native.board import NativeBoard
from plumb.contract import run_reference
from plumb.contract.parameters import ControlParams, groups_of, quantise
from plumb.contract.scenario import fitted
from plumb.kernels.reference import kernels as reference_kernels
from plumb.proof import runs
from plumb.spec.tuning import AnyTuning
from plumb.tuning.groups import filter_of
from plumb.tuning.variances import lsb_of

TURN_DEG = 360.0 / 2**32
NEAR_HALF_TURN_DEG = 0.01
"""Innovations this close to +-180 deg may wrap to either sign: the reference takes the sign of the integers."""

LEAST_G = 0.5
"""Least length of the acceleration for which the bounds of a chain with a wheel hold: the shorter the acceleration, the
more an error of a component changes its angle."""


@dataclass(frozen=True)
class FilterInputs:
    """Inputs of a filter in the firmware's formats, arrays (steps,). variance: 2^32 lsb; rate: U(k), turn/s Q28."""

    variance: npt.NDArray[np.int64]
    tilt_turn_q32: npt.NDArray[np.int64]
    rate_turnps_q28: npt.NDArray[np.int64]


def hard_inputs(params: ControlParams, steps: int, seed: int, bias_dps: float = 20.0) -> FilterInputs:
    """A sweep through the whole turn about every 25 s with superimposed swings, bias, noise and outliers."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(steps) * params.period_s
    tilt_deg = 14.0 * time_s + 40.0 * np.sin(0.9 * time_s) + 10.0 * np.sin(5.0 * time_s)
    rate_dps = 14.0 + 36.0 * np.cos(0.9 * time_s) + 50.0 * np.cos(5.0 * time_s)
    measured_deg = tilt_deg + rng.normal(0.0, 0.5, steps)
    measured_deg = np.where(rng.random(steps) < 0.02, rng.uniform(-180.0, 180.0, steps), measured_deg)
    gyro_dps = rate_dps + bias_dps + rng.normal(0.0, 0.5, steps)
    low, high = params["tilt.r_base"], params["tilt.r_max"]
    jumps = np.exp(rng.uniform(np.log(low), np.log(high), steps)) if high > low else np.full(steps, low)
    turns = np.rint(measured_deg / 360.0 * 2**32).astype(np.int64)
    return FilterInputs(
        np.clip(np.rint(jumps), low, high).astype(np.int64),
        (turns + 2**31) % 2**32 - 2**31,
        np.rint(gyro_dps / 360.0 * 2**28).astype(np.int64),
    )


def filter_error_deg(
    params: ControlParams, inputs: FilterInputs, near_half_turn_deg: float = NEAR_HALF_TURN_DEG
) -> npt.NDArray[np.float64]:
    """Fused tilt of the C integers minus the reference's, per step, wrapped; both on the same integer inputs."""
    settings, start, _ = filter_of(params)
    bias_limit_dps = 45.0 / params.period_s
    sure_deg = 180.0 - near_half_turn_deg
    z_q32, u_q28 = inputs.tilt_turn_q32, inputs.rate_turnps_q28
    fused, _ = native_core.kalman_run(params, inputs.variance, z_q32, u_q28)
    z_deg, u_dps = (z_q32 * TURN_DEG).tolist(), (u_q28 * (360.0 / 2**28)).tolist()
    r_deg2 = (inputs.variance * (lsb_of(params) * 2**32)).tolist()
    period_s = params.period_s
    x = reference_kernels.kalman_init(start)
    tilt_deg = np.empty(len(z_deg))
    for step, z in enumerate(z_deg):
        x.rate_dps = u_dps[step]  # U(k) is given, whichever sample it is
        reference_kernels.kalman_step(x, settings, period_s, z, u_dps[step], r_deg2[step])
        if abs(x.innovation_deg) > sure_deg:
            _same_way_round(params, inputs, step, x)
        if abs(x.bias_dps) > bias_limit_dps:  # an eighth of a turn per step is the format's limit
            x.bias_dps = math.copysign(bias_limit_dps, x.bias_dps)
        tilt_deg[step] = x.tilt_deg
    error: npt.NDArray[np.float64] = reference_kernels.wrap(fused.astype(np.float64) * TURN_DEG - tilt_deg)
    return error


def _same_way_round(params: ControlParams, inputs: FilterInputs, step: int, x: reference_kernels.KalmanState) -> None:
    """Make the reference's innovation wrap to the same side of +-180 deg as the integers'."""
    upto = slice(0, step + 1)
    _, states = native_core.kalman_run(
        params, inputs.variance[upto], inputs.tilt_turn_q32[upto], inputs.rate_turnps_q28[upto]
    )
    innovation_deg = float(states["innovation_turn_q32"][0]) * TURN_DEG
    if innovation_deg * x.innovation_deg < 0:
        turn = 360.0 if innovation_deg > 0 else -360.0
        x.tilt_deg = reference_kernels.wrap(x.tilt_deg + x.k0 * turn)
        x.bias_dps += x.k1 * turn
        x.innovation_deg += turn


def steady_gains(q_angle: float, q_bias: float, r: float) -> tuple[float, float]:
    """Gains of the stationary filter, bias counted per step; variances per step in any one unit.

    With S = R / (1 - k0) and L = -k1 = sqrt(q_bias / S) the Riccati equation is k0^2 = L (2 - k0) + q_angle / S.
    """
    low, high = 0.0, 1.0
    for _ in range(200):
        k0 = (low + high) / 2.0
        s = r / (1.0 - k0)
        lag = math.sqrt(q_bias / s)
        low, high = (k0, high) if k0 * k0 < lag * (2.0 - k0) + q_angle / s else (low, k0)
    return k0, -lag


def filter_bound_deg(params: ControlParams, innovation_deg: float = 180.0) -> float:
    """Bound of docs/explanation/accuracy.md for the error of the fused tilt against float64 with this set; at most 180.

    innovation_deg: the largest innovation of the run. Gains are those of the filter at rest with the largest R.
    """
    (kalman, start, _), dt = filter_of(params), params.period_s
    r = params["tilt.r_max"] * lsb_of(params) * 2**32
    q_angle, q_bias = kalman.q_angle_deg2_per_s * dt, kalman.q_bias_dps2_per_s * dt**3
    if q_bias == 0.0:
        return 180.0
    k0, k1 = steady_gains(q_angle, q_bias, r)
    p01_lsb = -k1 * r / (1.0 - k0) / lsb_of(params)
    gains = 2.0**-28 / -k1 + 2.0**-28 / k0
    covariance = 2.0**-31 / k0**2 + 1.0 / (k0 * p01_lsb)
    fall = 2.0**-29 * start.p11_dps2 * dt**2 / (params["tilt.r_base"] * lsb_of(params) * 2**32)
    return min(innovation_deg * (gains + covariance + fall) + 2.0 * TURN_DEG, 180.0)


def wheel_bounds(params: ControlParams) -> tuple[float, float]:
    """Bounds of the errors of velocity (m/s) and acceleration of the axle (g) against float64: rounding of their filter
    per step, which decays with alpha, rounding of the slope, and the error of the velocity times the slope's gain."""
    velocity_mps = 2.0**-25 / (params["wheel.alpha_q31"] / 2.0**31)
    gain = params["wheel.accel_gain_q30"] / 2.0**30
    return velocity_mps, gain * velocity_mps + (2.0**-24 if gain else 0.0)


def chain_bound_deg(params: ControlParams, innovation_deg: float = 180.0) -> float:
    """As filter_bound_deg(), for the chain from counts to angle: the filter's bound, the angle's error, the rounding of
    R, and with a wheel the error of the acceleration that is subtracted, at a length of LEAST_G or more."""
    _, _, trust = filter_of(params)
    r_share = 0.0
    if trust.gain_deg2:
        r_share = 3.0 / params["tilt.r_base"] + 2.0**-20 * math.sqrt(trust.gain_deg2 / trust.r_deg2)
    angle_deg = 1e-5 if params["tilt.mode"] == 0 else 5e-6
    if "wheel" in groups_of(params.system):
        angle_deg += math.degrees(wheel_bounds(params)[1] / LEAST_G)
    return min(filter_bound_deg(params, innovation_deg) + angle_deg + innovation_deg * r_share, 180.0)


def atan2_error_deg(y: npt.ArrayLike, x: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Binary angle minus float64, degrees; 0 for the point (0, 0)."""
    exact = reference_kernels.atan2(np.asarray(y, np.float64), np.asarray(x, np.float64))
    error: npt.NDArray[np.float64] = reference_kernels.wrap(native_core.atan2(y, x) * TURN_DEG - exact)
    return error


def asin_error_deg(x_q30: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Binary angle minus float64, degrees, of sines x / 2^30."""
    error: npt.NDArray[np.float64] = native_core.asin(x_q30) * TURN_DEG - reference_kernels.asin(
        np.asarray(x_q30) / 2**30
    )
    return error


def sincos_error(turn_q32: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """The larger error of sine and cosine of binary angles against float64."""
    angle = np.asarray(turn_q32, np.float64) * (2.0 * np.pi / 2.0**32)
    sine, cosine = native_core.sincos(turn_q32)
    return np.maximum(np.abs(sine / 2.0**30 - np.sin(angle)), np.abs(cosine / 2.0**30 - np.cos(angle)))


def chain_error_deg(params: ControlParams, raw: npt.ArrayLike, setpoint: npt.ArrayLike) -> float:
    """Largest error of the fused tilt over the whole chain: calibration, tilt, trust and filter in integers and in
    float64."""
    tilt_deg = native_core.run_control(params, raw, setpoint)["tilt_turn_q32"] * TURN_DEG
    error = reference_kernels.wrap(tilt_deg - run_reference.run_control(params, raw, setpoint)["tilt_deg"])
    return float(np.abs(error).max())


def scenario_error_deg(settings: AnyTuning, name: str, seed: int = 1000) -> float:
    """Largest error of any angle of the C core against float64 over the whole chain, on one of the system's
    scenarios."""
    run = systems.load(settings.system).scenario(name, seed, period_us=settings.period_us)
    params, inputs = quantise(fitted(run, settings)), runs.prescribed(run)
    answer = NativeBoard().run_injected(params, inputs.raw, inputs.setpoint)
    assert answer.words is not None
    ideal = run_reference.run_control(params, inputs.raw, inputs.setpoint)
    found = runs.Run(inputs, params, answer.words, ideal, answer, None).metrics()[
        systems.load(settings.system, runs.PLOTS).APART
    ]
    assert found is not None
    return float(found)


def _rows(names: Sequence[str], steps: int, seeds: int) -> Iterator[str]:
    yield "system    tuning            filter on the hard input (bound)         counts to angle on its scenario (bound)"
    for name in names:
        system = systems.load(name)
        for tuning, settings in system.TUNINGS.items():
            params = quantise(settings)
            # a tuning that is named after a scenario is for that one
            scenario = tuning if tuning in system.SCENARIOS else system.DEFAULT_SCENARIO
            own, hard, bound, chain = params.own(), "", "", ""
            if "tilt.r_base" in own:
                error = np.abs(filter_error_deg(params, hard_inputs(params, steps, seed=11))).max()
                hard, bound = f"{error:.1e} deg", f"({filter_bound_deg(params):.1e} deg)"
            if "pid.kp_q22" in own:  # one filter behind one angle
                chain = f"({chain_bound_deg(params):.1e} deg)"
            worst, seed = max(
                (scenario_error_deg(settings, scenario, seed), seed) for seed in range(1000, 1000 + seeds)
            )
            of = f"{scenario}, seed {seed}" if seeds > 1 else scenario
            yield f"{name:<10}{tuning:<18}{hard:<13}{bound:<28}{worst:.1e} deg {of:<10}{chain}".rstrip()
            if "wheel.alpha_q31" in own:
                velocity_mps, accel_g = wheel_bounds(params)
                turned_deg = math.degrees(accel_g / LEAST_G)
                yield f"{'':<28}wheel: {velocity_mps:.1e} m/s, {accel_g:.1e} g, {turned_deg:.1e} deg at {LEAST_G:g} g"
    rng = np.random.default_rng(1)
    y, x = rng.integers(-(1 << 31), 1 << 31, (2, steps))
    yield f"atan2 {np.abs(atan2_error_deg(y, x)).max():.1e} deg"
    yield f"asin  {np.abs(asin_error_deg(x >> 1)).max():.1e} deg"
    yield f"sincos {np.abs(sincos_error(x)).max():.1e}"


def main(arguments: Sequence[str] | None = None, steps: int = 1_000_000) -> None:
    parser = argparse.ArgumentParser(prog="python -m plumb.proof.accuracy")
    parser.add_argument("system", nargs="*", default=list(systems.SYSTEMS))
    parser.add_argument("--seeds", type=int, default=1, help="scenarios' seeds, from 1000 on (default 1)")
    given = parser.parse_args(arguments)
    for row in _rows(given.system, steps, given.seeds):
        print(row, flush=True)


if __name__ == "__main__":
    main()
