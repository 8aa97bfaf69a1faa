"""Checks of the parameter words that the arithmetic needs, written from docs/reference/arithmetic.

A step needs valid words: with others a sum could overflow, or a divisor be 0. These are the checks of the core itself;
the ranges of single words in the parameter table are equal or wider. `p` is
one set of words as they are in memory: an int32 may be negative, a uint32 not.
"""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import mulhi_u32, wrap_i64

LIMIT = 7 << 28
"""Limit of every calibrated value."""
COVARIANCE_MAX = 1 << 56
VARIANCE_MAX = 1 << 24
U32 = 0xFFFFFFFF


def _wide(p: Params, name: str) -> int:
    return wrap_i64((p[f"{name}_hi"] << 32) + p[f"{name}_lo"])


def calibration(p: Params, group: str) -> bool:
    """Both ends of the range of counts give a value within the limit."""
    low, high = p[f"{group}.raw_min"], p[f"{group}.raw_max"]
    ends = [end * p[f"{group}.gain"] + p[f"{group}.offset"] for end in (low, high)]
    return -(1 << 15) <= low <= high < 1 << 15 and all(-LIMIT <= end <= LIMIT for end in ends)


def tilt(p: Params) -> bool:
    """Measured tilt and its variance."""
    shift, base = p["tilt.deviation_shift"], p["tilt.r_base"]
    if p["tilt.mode"] > 1 or shift > 31 or p["tilt.deviation_max"] << shift > U32:
        return False
    d = p["tilt.deviation_max"] << shift
    return 1 <= base <= p["tilt.r_max"] <= VARIANCE_MAX and (base + mulhi_u32(mulhi_u32(d, d), p["tilt.r_gain"]) <= U32)


def kalman(p: Params, noise: str = "kalman", start: str = "start") -> bool:
    """The filter. noise, start: the parameter groups of its process noise and its start; the rest is in `kalman`."""
    shift, gain, most = p["kalman.rate_shift"], p["kalman.rate_gain"], p["kalman.bias_max_turn_q29"]
    if not (1 <= shift <= 16 and most >= 0):
        return False
    bias = (most + 1) << shift
    return (
        p["kalman.dt_s_q33"] >= 1
        and 0 <= p["kalman.rate_now"] <= 2
        and gain >= 1 << 30
        and bias <= 1 << 30
        and bias * gain < 1 << 60
        and _covariance(p, _wide(p, f"{noise}.qa"), start)
        and p[f"{noise}.qb_frac_q30"] < 1 << 30
    )


def _covariance(p: Params, qa: int, start: str) -> bool:
    p00, p01, p11 = (_wide(p, f"{start}.{name}") for name in ("p00", "p01", "p11"))
    return (
        0 <= qa <= COVARIANCE_MAX
        and abs(p[f"{start}.bias_hi"]) < 1 << 26
        and 0 <= p00 <= 2 * COVARIANCE_MAX
        and 0 <= p11 < COVARIANCE_MAX
        and max(-p00, -COVARIANCE_MAX) <= p01 <= p00
        and 4 * p01 <= qa
    )


def pid(p: Params, group: str = "pid") -> bool:
    """A controller."""
    gains = [abs(p[f"{group}.{name}"]) for name in ("kp_q22", "kd_q27")]
    slew = p[f"{group}.slew_q22"]
    positive = p[f"{group}.ki_dt_q22"] >= 0 and p[f"{group}.d_alpha_q31"] >= 0
    return max(gains) <= 1 << 30 and positive and 1 <= slew <= 1 << 23


def esc(p: Params) -> bool:
    """Pulses of speed controllers, half-microseconds."""
    pulses = [p[f"esc.{name}_halfus"] for name in ("neutral", "min", "mid", "max")]
    ordered = pulses == sorted(pulses) and pulses[0] >= 1800 and pulses[-1] <= 4200
    return ordered and pulses[0] <= 2200 and abs(p["esc.span_halfus"]) <= 2400


def wheel(p: Params) -> bool:
    """Speed from edges: at most 15 m/s for the largest number of edges."""
    edges = p["wheel.edges_max"]
    positive = p["wheel.alpha_q31"] >= 0 and p["wheel.accel_gain_q30"] >= 0
    return 1 <= edges < 1 << 15 and positive and edges * abs(p["wheel.edge_mps_q26"]) <= 15 << 26


def prefilter(p: Params, group: str) -> bool:
    """The test for spikes and the smoothing of a sensor."""
    return 1 <= p[f"{group}.spike_counts"] <= 1 << 17 and 1 <= p[f"{group}.smooth_q16"] <= 1 << 16
