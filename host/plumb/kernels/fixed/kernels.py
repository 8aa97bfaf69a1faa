"""The kernels that systems share, written from docs/reference/arithmetic/kernels.md alone.

`p` is a mapping from the names of parameters.toml to ints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plumb.kernels.fixed.trig import asin, atan2, reciprocal
from plumb.kernels.integers import clamp, clz32, mulhi_i32, mulhi_u32, wrap_i32, wrap_i64, wrap_u32

Params = Mapping[str, int]


@dataclass(slots=True)
class KalmanState:
    tilt_turn_q61: int
    bias_turn_q61: int
    p00: int
    p01: int
    p11: int
    p11_frac_q30: int = 0
    innovation_turn_q32: int = 0
    k0_q29: int = 0
    k1_q29: int = 0

    def words(self) -> tuple[int, ...]:
        return (
            self.tilt_turn_q61, self.bias_turn_q61, self.p00, self.p01, self.p11, self.p11_frac_q30,
            self.innovation_turn_q32, self.k0_q29, self.k1_q29,
        )  # fmt: skip


@dataclass(slots=True)
class PidState:
    integral_q54: int = 0
    command_q22: int = 0
    rate_filtered_turnps_q27: int = 0
    excess_q22: int = 0
    error_turn_q32: int = 0

    def words(self) -> tuple[int, ...]:
        return (
            self.integral_q54, self.command_q22, self.rate_filtered_turnps_q27, self.excess_q22, self.error_turn_q32
        )  # fmt: skip


def calibration_apply(p: Params, group: str, raw: int) -> tuple[int, bool]:
    """Calibrated value of the counts, and whether the counts were clamped."""
    used = clamp(raw, p[f"{group}.raw_min"], p[f"{group}.raw_max"])
    return wrap_i32(used * p[f"{group}.gain"] + p[f"{group}.offset"]), used != raw


def tilt_angle(p: Params, accel_y_g_q26: int, accel_z_g_q26: int) -> int:
    """Measured tilt, turn Q32."""
    if p["tilt.mode"] == 0:
        return asin(clamp(accel_y_g_q26, -(1 << 26), 1 << 26) * 16)
    return atan2(accel_y_g_q26, accel_z_g_q26)


def tilt_variance(p: Params, accel_y_g_q26: int, accel_z_g_q26: int) -> int:
    """Variance R of this step in 2^32 lsb, by the difference of |a|^2 from 1 g^2."""
    square_q20 = (accel_y_g_q26 * accel_y_g_q26 + accel_z_g_q26 * accel_z_g_q26) >> 32
    d = min(abs(square_q20 - (1 << 20)), p["tilt.deviation_max"]) << p["tilt.deviation_shift"]
    return min(p["tilt.r_base"] + mulhi_u32(mulhi_u32(d, d), p["tilt.r_gain"]), p["tilt.r_max"])


def kalman_init(p: Params) -> KalmanState:
    return KalmanState(
        tilt_turn_q61=p["start.tilt_turn_q32"] << 29,
        bias_turn_q61=wrap_i64(p["start.bias_hi"] << 32) + p["start.bias_lo"],
        p00=(p["start.p00_hi"] << 32) + p["start.p00_lo"],
        p01=(p["start.p01_hi"] << 32) + p["start.p01_lo"],
        p11=(p["start.p11_hi"] << 32) + p["start.p11_lo"],
    )


def driving_rate(p: Params, first: bool, present: int, before: int) -> int:
    """The rate that predicts the tilt, turn/s Q28."""
    if first or p["kalman.rate_now"] == 1:
        return present
    return (before + present) >> 1 if p["kalman.rate_now"] == 2 else before


def kalman_step(k: KalmanState, p: Params, r: int, z: int, u: int) -> None:
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


def kalman_tilt(k: KalmanState) -> int:
    """Fused tilt, turn Q32."""
    return wrap_i32(k.tilt_turn_q61 >> 29)


def kalman_predicted(k: KalmanState, p: Params, rate: int) -> int:
    """The measurement for which the innovation is 0, turn Q32."""
    return wrap_i32((k.tilt_turn_q61 - k.bias_turn_q61 + rate * p["kalman.dt_s_q33"]) >> 29)


def kalman_bias(k: KalmanState, p: Params) -> int:
    """Bias, turn/s Q28, within its limit."""
    limit = p["kalman.bias_max_turn_q29"]
    bias = (clamp(k.bias_turn_q61 >> 32, -limit, limit) << 32) + wrap_u32(k.bias_turn_q61)
    return mulhi_i32(wrap_i32((bias << p["kalman.rate_shift"]) >> 32), p["kalman.rate_gain"])


def pid_step(c: PidState, p: Params, error: int, rate: int, group: str = "pid") -> None:
    """One step of the controller. error: turn Q32; rate: turn/s Q28; group: name of its parameter group."""
    step = wrap_i32((rate >> 1) - c.rate_filtered_turnps_q27)
    filtered = wrap_i32(c.rate_filtered_turnps_q27 + 2 * mulhi_i32(step, p[f"{group}.d_alpha_q31"]))
    c.rate_filtered_turnps_q27 = filtered

    demand = mulhi_i32(error, p[f"{group}.kp_q22"]) - mulhi_i32(filtered, p[f"{group}.kd_q27"])
    demand += c.integral_q54 >> 32
    wanted = clamp(demand, -(1 << 22), (1 << 22) - 1)
    slew = p[f"{group}.slew_q22"]
    before = ((c.command_q22 + (1 << 22)) & ((1 << 23) - 1)) - (1 << 22)
    c.command_q22 = before + clamp(wanted - before, -slew, slew)

    excess = c.excess_q22 = demand - c.command_q22
    integral = c.integral_q54
    if excess == 0 or (excess < 0) != (error < 0):
        integral += error * p[f"{group}.ki_dt_q22"]
    c.integral_q54 = (clamp(integral >> 32, -(1 << 23), (1 << 23) - 1) << 32) + wrap_u32(integral)
    c.error_turn_q32 = error


def pid_retune(c: PidState, old: Params, new: Params, group: str = "pid") -> None:
    """Other gains from the next step on, without a jump: at the last error and rate the demand keeps its value, because
    the integral takes up the difference. The integral does not change where ki dt is 0."""
    if new[f"{group}.ki_dt_q22"] == 0:
        return
    high = (c.integral_q54 >> 32) + pid_direct(c, old, group) - pid_direct(c, new, group)
    c.integral_q54 = (clamp(high, -(1 << 23), (1 << 23) - 1) << 32) + wrap_u32(c.integral_q54)


def pid_direct(c: PidState, p: Params, group: str) -> int:
    """The P and D terms at the last error and rate, Q22, which a step adds to the integral."""
    proportional = mulhi_i32(c.error_turn_q32, p[f"{group}.kp_q22"])
    return proportional - mulhi_i32(c.rate_filtered_turnps_q27, p[f"{group}.kd_q27"])
