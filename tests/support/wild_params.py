"""Random parameters at the edges of what the firmware accepts, as integers: no tuning a person would write."""

from __future__ import annotations

import numpy as np

from plumb.contract.parameters import ControlParams
from plumb.spec import parameters
from plumb.systems.attitude.quantise import LEAST_STEPS, MOST_STEPS
from plumb.tuning.mounting import mounting_words

LONGEST_BLOCK_Q33 = 2731598643


def log_uniform(rng: np.random.Generator, low: int, high: int) -> int:
    """An integer in [low, high], 0 <= low: every size as likely as any other, the ends themselves now and then."""
    if low >= high or rng.random() < 0.05:
        return min(low, high)
    if rng.random() < 0.05:
        return high
    return min(max(int(2.0 ** rng.uniform(np.log2(max(low, 0.5)), np.log2(high))), low), high)


def signed(rng: np.random.Generator, limit: int) -> int:
    return log_uniform(rng, 0, limit) * int(rng.choice([-1, 1]))


def channel(rng: np.random.Generator) -> tuple[int, int, int, int]:
    """raw_min, raw_max, gain, offset with both ends within +-7 * 2^28."""
    low, high = sorted(int(count) for count in rng.integers(-32768, 32768, 2))
    if rng.random() < 0.3:
        low, high = -32768, 32767
    limit = 7 << 28
    first, last = signed(rng, limit), signed(rng, limit)
    gain = int((last - first) / (high - low)) if high > low else signed(rng, 1 << 20)
    offset = first - gain * low
    if not -(1 << 31) <= offset < 1 << 31 or max(abs(gain * low + offset), abs(gain * high + offset)) > limit:
        return channel(rng)
    return low, high, gain, offset


def _controller(rng: np.random.Generator, group: str) -> dict[str, int]:
    values = {f"{group}.kp_q22": signed(rng, 1 << 30), f"{group}.ki_dt_q22": log_uniform(rng, 0, (1 << 31) - 1)}
    values |= {f"{group}.kd_q27": signed(rng, 1 << 30), f"{group}.d_alpha_q31": log_uniform(rng, 0, (1 << 31) - 1)}
    return values | {f"{group}.slew_q22": log_uniform(rng, 1, 1 << 23)}


def _shared(rng: np.random.Generator) -> dict[str, int]:
    """Calibration, trust, filter and controller."""
    values: dict[str, int] = {}
    for name in ("gyro", "accel", "accel_up"):
        for key, value in zip(("raw_min", "raw_max", "gain", "offset"), channel(rng), strict=True):
            values[f"{name}.{key}"] = value

    r_base = log_uniform(rng, 1, 1 << 24)
    shift = int(rng.integers(0, 32))
    deviation = log_uniform(rng, 0, (1 << 32 - shift) - 1)
    square = ((deviation << shift) ** 2) >> 32
    gain = log_uniform(rng, 0, min(((1 << 64) - (r_base << 32) - 1) // max(square, 1), (1 << 32) - 1))
    values |= {"tilt.mode": int(rng.integers(0, 2)), "tilt.r_base": r_base, "tilt.r_gain": gain}
    values |= {"tilt.r_max": log_uniform(rng, r_base, 1 << 24)}
    values |= {"tilt.deviation_max": deviation, "tilt.deviation_shift": shift}

    rate_shift, rate_gain = int(rng.integers(1, 17)), int(rng.integers(1 << 30, 1 << 31))
    most_bias = min((1 << 30) >> rate_shift, ((1 << 60) - 1) // rate_gain >> rate_shift) - 1
    qa, p00 = log_uniform(rng, 0, 1 << 56), log_uniform(rng, 0, 1 << 57)
    p01 = min(signed(rng, min(p00, 1 << 56)), qa // 4)
    p11, bias = log_uniform(rng, 0, (1 << 56) - 1), signed(rng, ((1 << 26) - 1) << 32)
    values |= {"kalman.dt_s_q33": log_uniform(rng, 1, 858993459), "kalman.rate_now": int(rng.integers(0, 3))}
    values |= {"kalman.qa_hi": qa >> 32, "kalman.qa_lo": qa & 0xFFFFFFFF}
    values |= {"kalman.qb": log_uniform(rng, 0, (1 << 32) - 1), "kalman.qb_frac_q30": int(rng.integers(0, 1 << 30))}
    values |= {"kalman.bias_max_turn_q29": log_uniform(rng, 0, most_bias)}
    values |= {"kalman.rate_gain": rate_gain, "kalman.rate_shift": rate_shift}
    values |= {"start.bias_hi": bias >> 32, "start.bias_lo": bias & 0xFFFFFFFF}
    values |= {"start.tilt_turn_q32": int(rng.integers(-(1 << 31), 1 << 31))}
    for name, value in (("p00", p00), ("p01", p01), ("p11", p11)):
        values |= {f"start.{name}_hi": value >> 32, f"start.{name}_lo": value & 0xFFFFFFFF}

    return values | _controller(rng, "pid")


def wild_params(rng: np.random.Generator) -> ControlParams:
    """Parameters of quad that control_params_valid accepts."""
    values = _shared(rng)
    low, mid, high = sorted(int(pulse) for pulse in rng.integers(1800, 4201, 3))
    neutral = int(rng.integers(1800, min(low, 2200) + 1))
    values |= {"esc.mid_halfus": mid, "esc.span_halfus": signed(rng, 2400)}
    values |= {"esc.min_halfus": low, "esc.max_halfus": high, "esc.neutral_halfus": neutral}
    return ControlParams.of("quad", values)


def wild_balancer_params(rng: np.random.Generator) -> ControlParams:
    """Parameters of balancer that control_params_valid accepts."""
    values = _shared(rng) | _controller(rng, "speed")
    edges = log_uniform(rng, 1, 32767)
    values |= {"wheel.edges_max": edges, "wheel.edge_mps_q26": signed(rng, (15 << 26) // edges)}
    values |= {"wheel.alpha_q31": log_uniform(rng, 0, (1 << 31) - 1)}
    values |= {"wheel.accel_gain_q30": log_uniform(rng, 0, (1 << 31) - 1)}
    values |= {"drive.speed_max_mps_q26": log_uniform(rng, 0, 8 << 26)}
    values |= {"drive.lean_max_turn_q34": log_uniform(rng, 0, 1 << 30)}
    values |= {"drive.span_q15": signed(rng, 32767), "drive.duty_max_q15": log_uniform(rng, 0, 32767)}
    # in most runs never fallen: there would be nothing left to see
    fall = 1 << 31 if rng.random() < 0.7 else log_uniform(rng, 0, 1 << 31)
    return ControlParams.of("balancer", values | {"drive.fall_turn_q32": fall})


def wild_phone_params(rng: np.random.Generator) -> ControlParams:
    """Parameters of phone that control_params_valid accepts: both filters wild, each in its own way."""
    groups = ("gyro", "accel", "tilt", "kalman", "start")
    values = {name: value for name, value in _shared(rng).items() if name.rpartition(".")[0] in groups}
    second = _shared(rng)
    values |= {f"roll.{name}": second[f"kalman.{name}"] for name in ("qa_hi", "qa_lo", "qb", "qb_frac_q30")}
    values |= {f"roll.{name}": second[f"tilt.{name}"] for name in ("r_base", "r_max")}
    values |= {f"roll.{name}": value for name, value in second.items() if name.startswith("start.")}
    return ControlParams.of("phone", values | {"phone.rates": int(rng.random() < 0.8)})


def wild_turntable_params(rng: np.random.Generator) -> ControlParams:
    """Parameters of turntable anywhere in their ranges, the two that are tied together within their tie."""
    values: dict[str, int] = {}
    for name in ("gyro", "angular"):
        for key, value in zip(("raw_min", "raw_max", "gain", "offset"), channel(rng), strict=True):
            values[f"{name}.{key}"] = value
        values[f"{name}_filter.spike_counts"] = log_uniform(rng, 1, 1 << 17)
        values[f"{name}_filter.smooth_q16"] = log_uniform(rng, 1, 1 << 16)
    for row in parameters.table():
        if row.name.startswith("fusion."):
            values[row.name] = log_uniform(rng, row.min, row.max)
    period = values["fusion.gyro_period_step_q24"]
    values["fusion.gyro_age_step_q24"] = int(rng.integers(0, period))
    values |= {"fusion.rest_steps": int(rng.integers(0, 150)), "fusion.layer": int(rng.integers(0, 3))}
    return ControlParams.of("turntable", values)


def wild_attitude_params(rng: np.random.Generator) -> ControlParams:
    """Parameters of attitude anywhere in their ranges; half of the runs mounted, their axes mapped or almost so."""
    values: dict[str, int] = {}
    for name in ("gyro", "accel"):
        for key, value in zip(("raw_min", "raw_max", "gain", "offset"), channel(rng), strict=True):
            values[f"{name}.{key}"] = value
        matrix = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)
        matrix *= np.linalg.det(matrix)
        if rng.random() < 0.7:
            matrix = matrix + rng.uniform(-0.1, 0.1, (3, 3))
        values |= mounting_words(f"{name}_mounting", matrix)
    for row in parameters.table():
        if row.name.startswith("attitude."):
            values[row.name] = log_uniform(rng, row.min, row.max)
    values["attitude.mounted"] = int(rng.integers(0, 2))
    steps = LEAST_STEPS if rng.random() < 0.6 else log_uniform(rng, LEAST_STEPS, MOST_STEPS)
    longest = min(LONGEST_BLOCK_Q33 // steps, values["attitude.dt_s_q33"])
    values |= {"attitude.block_steps": steps, "attitude.dt_s_q33": max(longest, 8589934)}
    values["attitude.half_angle"] = min((1 << 34) // steps, values["attitude.half_angle"])
    for name in ("rest_blocks",):
        values[f"attitude.{name}"] = 1 if rng.random() < 0.4 else log_uniform(rng, 1, 255)
    return ControlParams.of("attitude", values)
