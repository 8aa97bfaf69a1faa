"""The integer algorithm, written from DESIGN.md "Numbers" alone: every bit of every word of a step.

Kernels work on ints (one run) and on int64 arrays (one value per run) with the same code. `p` is a mapping from the
names of parameters.toml to ints, or to arrays where runs differ. Golden vectors come from here.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.angle import asin, atan2, reciprocal
from plumb.errors import UsageError
from plumb.integers import Integer, clamp, clz32, mulhi_u32, select, wrap_i32, wrap_i64, wrap_u32
from plumb.quantise import ControlParams
from plumb.words import WORDS_DTYPE, Words

__all__ = ["Controller", "asin", "atan2", "calibrate", "control_step", "kalman_step", "pid_step", "run_control"]

Params = Mapping[str, Integer]

FLAG_COMMAND_LIMITED = 1 << 3


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


@dataclass(slots=True)
class ControlState:
    kalman: KalmanState
    pid: PidState
    rate_turnps_q28: Integer = 0
    clamped_steps: Integer = 0
    step: int = 0


def calibrate(raw: Integer, p: Params, channel: str) -> tuple[Integer, Integer]:
    """Counts to units; and 1 where the counts had to be clamped."""
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
    """R of this step in 2^32 lsb, from how far |a|^2 is from 1 g^2."""
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


def kalman_step(k: KalmanState, p: Params, r: Integer, z: Integer, u: Integer) -> None:
    """r: variance in 2^32 lsb; z: measured tilt, turn Q32; u: gyro, turn/s Q28. Equations as in `plumb.reference`."""
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


def pid_step(c: PidState, p: Params, error: Integer, rate: Integer) -> None:
    """error: turn Q32; rate: turn/s Q28."""
    x = wrap_i32((rate >> 1) - c.rate_filtered_turnps_q27)
    c.rate_filtered_turnps_q27 = wrap_i32(c.rate_filtered_turnps_q27 + 2 * ((x * p["pid.d_alpha_q31"]) >> 32))
    demand = ((error * p["pid.kp_q22"]) >> 32) - ((c.rate_filtered_turnps_q27 * p["pid.kd_q27"]) >> 32)
    demand = demand + (c.integral_q54 >> 32)
    wanted = clamp(demand, -(1 << 22), (1 << 22) - 1)
    slew = p["pid.slew_q22"]
    c.command_q22 = c.command_q22 + clamp(wanted - c.command_q22, -slew, slew)

    c.excess_q22 = demand - c.command_q22
    further = (c.excess_q22 != 0) & ((c.excess_q22 < 0) == (error < 0))
    w = c.integral_q54 + select(further, 0, error) * p["pid.ki_dt_q22"]
    c.integral_q54 = (clamp(w >> 32, -(1 << 23), (1 << 23) - 1) << 32) + wrap_u32(w)


def esc(command_q22: Integer, p: Params) -> tuple[Integer, Integer]:
    """Pulses of the two opposing motors in half-microseconds."""
    d = ((command_q22 >> 6) * p["esc.span_halfus"] + (1 << 15)) >> 16
    mid, low, high = p["esc.mid_halfus"], p["esc.min_halfus"], p["esc.max_halfus"]
    return clamp(mid + d, low, high), clamp(mid - d, low, high)


def control_init(p: Params) -> ControlState:
    return ControlState(kalman_init(p), PidState())


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint_turn_q32: Integer) -> tuple[Integer, ...]:
    """One step: the values of its words, in the written order."""
    c.step += 1
    previous = c.rate_turnps_q28
    rate, gyro_clamped = calibrate(raw[0], p, "gyro")
    accel_y, y_clamped = calibrate(raw[1], p, "accel_y")
    accel_z, z_clamped = calibrate(raw[2], p, "accel_z")
    c.rate_turnps_q28 = rate
    u = rate if c.step == 1 else select(p["kalman.rate_now"] == 1, rate, previous)
    measured = tilt(accel_y, accel_z, p)
    variance = trust(accel_y, accel_z, p)
    k, pid = c.kalman, c.pid
    kalman_step(k, p, variance, measured, u)

    tilt_turn_q32 = wrap_i32(k.tilt_turn_q61 >> 29)
    limit = p["kalman.bias_max_turn_q29"]
    h = clamp(k.bias_turn_q61 >> 32, -limit, limit)
    shifted = wrap_i64(((h << 32) + wrap_u32(k.bias_turn_q61)) << p["kalman.rate_shift"])
    bias = (wrap_i32(shifted >> 32) * p["kalman.rate_gain"]) >> 32
    rate_corrected = rate - bias
    error = wrap_i32(setpoint_turn_q32 - tilt_turn_q32)
    pid_step(pid, p, error, rate_corrected)
    pulse = esc(pid.command_q22, p)
    clamped = gyro_clamped | y_clamped << 1 | z_clamped << 2
    c.clamped_steps = c.clamped_steps + select(clamped != 0, 1, 0)
    flags = clamped | select(pid.excess_q22 != 0, FLAG_COMMAND_LIMITED, 0)
    return (
        *raw, setpoint_turn_q32, rate, accel_y, accel_z, measured, variance,
        k.tilt_turn_q61, k.bias_turn_q61, k.p00, k.p01, k.p11, k.p11_frac_q30,
        k.innovation_turn_q32, k.k0_q29, k.k1_q29,
        tilt_turn_q32, bias, rate_corrected, c.clamped_steps,
        pid.integral_q54, pid.command_q22, pid.rate_filtered_turnps_q27, pid.excess_q22, error,
        *pulse, flags, c.step,
    )  # fmt: skip


RECORD = struct.Struct("<11iI5qI6iIq4i4I")


class Controller:
    """One run, a step at a time."""

    def __init__(self, params: ControlParams) -> None:
        self._p, self._c = params.values, control_init(params.values)
        self._row: tuple[int, ...] = ()

    def step(self, raw: Sequence[int], setpoint_turn_q32: int) -> dict[str, int]:
        """The words of this step by name; raw: up to 6 counts, the rest are 0."""
        counts = [int(count) for count in raw]
        self._row = control_step(self._c, self._p, counts + [0] * (6 - len(counts)), int(setpoint_turn_q32))
        return dict(zip(WORDS_DTYPE.names or (), self._row, strict=True))

    def record(self) -> bytes:
        """The last step's bytes, as the digest is taken over them."""
        return RECORD.pack(*self._row)

    def digest(self) -> int:
        """CRC-32 of the last step's words."""
        return zlib.crc32(self.record())


def run_control(
    params: ControlParams | Sequence[ControlParams], raw: npt.ArrayLike, setpoint_turn_q32: npt.ArrayLike
) -> Words:
    """raw: (steps, up to 6 counts[, runs]); setpoint: (steps[, runs]); one set of parameters, or one per run."""
    counts, setpoint = check_inputs(raw, setpoint_turn_q32)
    steps = len(counts)
    if counts.ndim == 2 and isinstance(params, ControlParams):
        p, c = params.values, control_init(params.values)
        rows = zip(counts.tolist(), setpoint.tolist(), strict=True)
        data = b"".join(RECORD.pack(*control_step(c, p, row, target)) for row, target in rows)
        return Words.from_bytes(data, (steps,))
    runs = counts.shape[2] if counts.ndim == 3 else 1
    columns = stack(params, runs)
    c = control_init(columns)
    record = np.zeros((steps, runs), WORDS_DTYPE)
    for step in range(steps):
        row = control_step(c, columns, counts[step].reshape(6, runs), setpoint[step].reshape(runs))
        for name, value in zip(WORDS_DTYPE.names or (), row, strict=True):
            record[name][step] = value
    return Words(record if counts.ndim == 3 else record[:, 0])


def stack(params: ControlParams | Sequence[ControlParams], runs: int) -> dict[str, npt.NDArray[np.int64]]:
    """Parameters as columns, one value per run."""
    sets = [params] * runs if isinstance(params, ControlParams) else list(params)
    if len(sets) != runs:
        raise UsageError(f"{len(sets)} parameter sets were given for {runs} runs: give one, or one per run")
    return {name: np.array([one[name] for one in sets], np.int64) for name in sets[0].values}


def check_inputs(
    raw: npt.ArrayLike, setpoint_turn_q32: npt.ArrayLike
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Counts as (steps, 6[, runs]) and setpoints as (steps[, runs]), of int16 and int32 range; UsageError otherwise."""
    counts, setpoint = np.asarray(raw), np.asarray(setpoint_turn_q32)
    for name, values, bits in (("raw counts", counts, 16), ("setpoints", setpoint, 32)):
        if values.dtype.kind not in "iu":
            raise UsageError(f"{name} are {values.dtype}: round them to integers first")
        if values.size and (values.min() < -(1 << bits - 1) or values.max() >= 1 << bits - 1):
            raise UsageError(f"{name} reach {values.min()} to {values.max()}: they have {bits} bits")
    if counts.ndim not in (2, 3) or not 3 <= counts.shape[1] <= 6:
        raise UsageError(f"raw counts of shape {counts.shape}: give (steps, 3 to 6) or (steps, 3 to 6, runs)")
    if setpoint.shape != (len(counts), *counts.shape[2:]):
        raise UsageError(f"setpoints of shape {setpoint.shape} do not match raw counts of shape {counts.shape}")
    whole = np.zeros((len(counts), 6, *counts.shape[2:]), np.int64)
    whole[:, : counts.shape[1]] = counts
    return whole, setpoint.astype(np.int64)
