"""The kernels that systems share, written from docs/reference/arithmetic/kernels.md alone.

They work on ints (one run) and on int64 arrays (one value per run) with the same code. `p` is a mapping from the names
of parameters.toml to ints, or to arrays where runs differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plumb.kernels.fixed.trig import asin, atan2, reciprocal
from plumb.kernels.integers import Integer, clamp, clz32, mulhi_u32, select, wrap_i32, wrap_i64, wrap_u32

Params = Mapping[str, Integer]


@dataclass(slots=True)
class KalmanState:
    tilt_turn_q61: Integer
    bias_turn_q61: Integer
    p00: Integer
    p01: Integer
    p11: Integer
    p11_frac_q30: Integer = 0
    innovation_turn_q32: Integer = 0
    k0_q29: Integer = 0
    k1_q29: Integer = 0


@dataclass(slots=True)
class PidState:
    integral_q54: Integer = 0
    command_q22: Integer = 0
    rate_filtered_turnps_q27: Integer = 0
    excess_q22: Integer = 0
    error_turn_q32: Integer = 0


def calibrate(raw: Integer, p: Params, channel: str) -> tuple[Integer, Integer]:
    """Calibrated value of the counts, and 1 where the counts were clamped, else 0."""
    used = clamp(raw, p[f"{channel}.raw_min"], p[f"{channel}.raw_max"])
    return wrap_i32(used * p[f"{channel}.gain"] + p[f"{channel}.offset"]), select(used != raw, 1, 0)


def tilt(accel_y_g_q26: Integer, accel_z_g_q26: Integer, p: Params) -> Integer:
    """Measured tilt, turn Q32."""
    arcsine = p["tilt.mode"] == 0
    sine_q30 = clamp(accel_y_g_q26, -(1 << 26), 1 << 26) * 16
    if isinstance(arcsine, bool):
        return asin(sine_q30) if arcsine else atan2(accel_y_g_q26, accel_z_g_q26)
    return select(arcsine, asin(sine_q30), atan2(accel_y_g_q26, accel_z_g_q26))


def trust(accel_y_g_q26: Integer, accel_z_g_q26: Integer, p: Params) -> Integer:
    """Variance R of this step in 2^32 lsb, by the difference of |a|^2 from 1 g^2."""
    m = (accel_y_g_q26 * accel_y_g_q26 + accel_z_g_q26 * accel_z_g_q26) >> 32
    d = clamp(abs(m - (1 << 20)), 0, p["tilt.deviation_max"]) << p["tilt.deviation_shift"]
    return clamp(p["tilt.r_base"] + mulhi_u32(mulhi_u32(d, d), p["tilt.r_gain"]), 0, p["tilt.r_max"])


def kalman_init(p: Params) -> KalmanState:
    return KalmanState(
        tilt_turn_q61=p["start.tilt_turn_q32"] << 29,
        bias_turn_q61=wrap_i64(p["start.bias_hi"] << 32) + p["start.bias_lo"],
        p00=(p["start.p00_hi"] << 32) + p["start.p00_lo"],
        p01=(p["start.p01_hi"] << 32) + p["start.p01_lo"],
        p11=(p["start.p11_hi"] << 32) + p["start.p11_lo"],
    )


def driving_rate(p: Params, rate: Integer, previous: Integer) -> Integer:
    """The rate that predicts the tilt, U(k), turn/s Q28."""
    choice = p["kalman.rate_now"]
    return select(choice == 2, (previous + rate) >> 1, select(choice == 1, rate, previous))


def kalman_step(k: KalmanState, p: Params, r: Integer, z: Integer, u: Integer) -> None:
    """One predict and update. r: variance in 2^32 lsb; z: measured tilt, turn Q32; u: gyro rate, turn/s Q28. Equations
    as in `plumb.kernels.reference.kernels`."""
    # (2)
    p01 = wrap_i64(k.p01 - k.p11)
    p00 = wrap_i64(k.p00 - k.p01 - p01 + (p["kalman.qa_hi"] << 32) + p["kalman.qa_lo"])

    # (4) S = p00 + r * 2^32, normalised by n; y = 2^61 / S
    n = clz32((p00 >> 32) + r)
    p00a = wrap_u32((p00 << (n - 1)) >> 32) | 1
    p01a = wrap_i32((p01 << (n - 1)) >> 32) | 1
    sa = p00a + (r << (n - 1))
    y = reciprocal(sa)
    g = p00a * y
    k0_q32 = wrap_u32(g >> 29) | 1
    k0_q29 = g >> 32
    k1_q29 = (p01a * y + (1 << 31)) >> 32

    # (5)
    k.p00 = r * k0_q32
    d = k1_q29 * p01a
    f = k.p11_frac_q30 + p["kalman.qb_frac_q30"] - (wrap_u32(wrap_u32(d) << (36 - n)) >> 2)
    p11n = k.p11 + p["kalman.qb"] + (f >> 30) - (d >> (n - 4))
    k.p11 = (clamp(p11n >> 32, 0, (1 << 24) - 1) << 32) + wrap_u32(p11n)
    k.p11_frac_q30 = f & ((1 << 30) - 1)
    c = 0xFFFFFFFF - k0_q32
    k.p01 = (p01 >> 32) * c + mulhi_u32(wrap_u32(p01), c)

    # (1)
    t = wrap_i64(k.tilt_turn_q61 - k.bias_turn_q61 + u * p["kalman.dt_s_q33"])
    # (3)
    innovation = wrap_i32(z - (t >> 29))
    k.tilt_turn_q61 = wrap_i64(t + k0_q29 * innovation)
    b = wrap_i64(k.bias_turn_q61 + k1_q29 * innovation)
    k.bias_turn_q61 = (clamp(b >> 32, -(1 << 26), (1 << 26) - 1) << 32) + wrap_u32(b)
    k.innovation_turn_q32, k.k0_q29, k.k1_q29 = innovation, k0_q29, k1_q29


def kalman_tilt(k: KalmanState) -> Integer:
    """Fused tilt, turn Q32."""
    return wrap_i32(k.tilt_turn_q61 >> 29)


def kalman_bias(k: KalmanState, p: Params) -> Integer:
    """Bias, turn/s Q28, within its limit."""
    limit = p["kalman.bias_max_turn_q29"]
    h = clamp(k.bias_turn_q61 >> 32, -limit, limit)
    shifted = wrap_i64(((h << 32) + wrap_u32(k.bias_turn_q61)) << p["kalman.rate_shift"])
    return (wrap_i32(shifted >> 32) * p["kalman.rate_gain"]) >> 32


def pid_step(c: PidState, p: Params, error: Integer, rate: Integer, group: str = "pid") -> None:
    """One step of the controller. error: turn Q32; rate: turn/s Q28; group: name of its parameter group."""
    x = wrap_i32((rate >> 1) - c.rate_filtered_turnps_q27)
    c.rate_filtered_turnps_q27 = wrap_i32(c.rate_filtered_turnps_q27 + 2 * ((x * p[f"{group}.d_alpha_q31"]) >> 32))
    demand = ((error * p[f"{group}.kp_q22"]) >> 32) - ((c.rate_filtered_turnps_q27 * p[f"{group}.kd_q27"]) >> 32)
    demand = demand + (c.integral_q54 >> 32)
    wanted = clamp(demand, -(1 << 22), (1 << 22) - 1)
    slew = p[f"{group}.slew_q22"]
    before = ((c.command_q22 + (1 << 22)) & ((1 << 23) - 1)) - (1 << 22)
    c.command_q22 = before + clamp(wanted - before, -slew, slew)

    c.excess_q22 = demand - c.command_q22
    further = (c.excess_q22 != 0) & ((c.excess_q22 < 0) == (error < 0))
    w = c.integral_q54 + select(further, 0, error) * p[f"{group}.ki_dt_q22"]
    c.integral_q54 = (clamp(w >> 32, -(1 << 23), (1 << 23) - 1) << 32) + wrap_u32(w)
    c.error_turn_q32 = error


def pid_retune(c: PidState, old: Params, new: Params, group: str = "pid") -> None:
    """Other gains from the next step on, without a jump: at the last error and rate the demand keeps its value, because
    the integral takes up the difference. The integral does not change where ki dt is 0."""
    moved = pid_direct(c, old, group) - pid_direct(c, new, group)
    high = clamp((c.integral_q54 >> 32) + moved, -(1 << 23), (1 << 23) - 1)
    keeps = new[f"{group}.ki_dt_q22"] == 0
    c.integral_q54 = select(keeps, c.integral_q54, (high << 32) + wrap_u32(c.integral_q54))


def pid_direct(c: PidState, p: Params, group: str) -> Integer:
    """The P and D terms at the last error and rate, Q22, which a step adds to the integral."""
    proportional = (c.error_turn_q32 * p[f"{group}.kp_q22"]) >> 32
    return proportional - ((c.rate_filtered_turnps_q27 * p[f"{group}.kd_q27"]) >> 32)
