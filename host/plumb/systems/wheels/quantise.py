"""Quantise the tuning of `wheels`, and back."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.systems.balancer import quantise as balancer
from plumb.systems.wheels.tuning import Riding, Turning, Watching, WheelsTuning
from plumb.systems.wheels.vehicle import G_MPS2
from plumb.tuning.groups import check_numbers, not_negative, refuse, whole

MOST, GAIN_MAX = (1 << 31) - 1, 1 << 30
TURN = 360.0
RATE_MAX = 4 << 28
"""Largest turn rate that is asked for, and that the wheels may show, turn/s Q28."""
STEPS_MAX = 65534


def quantise(tuning: WheelsTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    check_numbers(tuning)
    balanced = balancer.quantise(replace(tuning.balance, period_us=tuning.period_us, exact_period_s=None))
    dt = tuning.period_us * 1e-6
    own = {**balanced.own(), **_turning(tuning.turning, dt), **_riding(tuning.riding, dt)}
    own |= _watching(tuning.watching, dt)
    return ControlParams.of("wheels", own, balanced.context)


def _word(name: str, asked: float, value: float, high: int) -> int:
    not_negative({name: asked})
    return whole(name, asked, Fraction(value), 0, high)


def _turning(turning: Turning, dt: float) -> dict[str, int]:
    def word(name: str, scale: float, high: int) -> int:
        asked = float(getattr(turning, name))
        return _word(f"turning.{name}", asked, asked * scale, high)

    if not turning.track_m:
        refuse("turning.track_m", turning.track_m, "wheels are apart")
    per_count = turning.count_m / dt / turning.track_m / math.tau * 2**28
    count = whole("turning.count_m", turning.count_m, Fraction(per_count), -GAIN_MAX, GAIN_MAX)
    shown = turning.wheels_max_dps / TURN * 2**28
    most = min(int(shown / abs(count)), (1 << 15) - 1) if count else (1 << 15) - 1
    if most < 1 or shown > RATE_MAX:
        refuse("turning.wheels_max_dps", turning.wheels_max_dps, "a count or more, and at most 1440 deg/s", 0.0, 1440.0)
    if turning.bias_tau_s <= 0:
        refuse("turning.bias_tau_s", turning.bias_tau_s, "more than 0", 0.0)
    share = -math.expm1(-dt / turning.bias_tau_s)
    return {
        "wheels.count_turnps_q28": count,
        "wheels.counts_max": most,
        "wheels.bias_alpha_q31": _word("turning.bias_tau_s", turning.bias_tau_s, share * 2**31, 1 << 30),
        "wheels.doubt_turnps_q28": word("doubt_dps", 2**28 / TURN, 1 << 28),
        "wheels.slip_turnps_q28": word("slip_dps", 2**28 / TURN, RATE_MAX),
        "wheels.turn_counts_q36": max(min(round(2**36 / count), GAIN_MAX), -GAIN_MAX) if count else 0,
        "wheels.slip_mps_q26": word("slip_mps", 2**26, 1 << 29),
        "wheels.slip_hold": _steps("turning.slip_s", turning.slip_s, dt, 0),
        "wheels.turn_max_turnps_q28": word("rate_max_dps", 2**28 / TURN, RATE_MAX),
        "wheels.integral_max_q30": word("integral_max", 2**30, 1 << 30),
        "wheels.turn_duty_max_q15": word("duty_max", 2**15, 32767),
        "turn.kp_q29": word("kp_per_dps", TURN * 2**29, GAIN_MAX),
        "turn.ki_dt_q35": word("ki_per_deg", TURN * dt * 2**35, MOST),
        "turn.kd_q28": word("kd_per_dps2", TURN / dt * 2**28, GAIN_MAX),
        "turn.ff_q29": word("ff_per_dps", TURN * 2**29, GAIN_MAX),
    }


def _steps(name: str, seconds: float, dt: float, least: int) -> int:
    """Whole steps, the nearest."""
    steps = round(seconds / dt)
    if not least <= steps <= STEPS_MAX:
        refuse(name, seconds, f"{least} to {STEPS_MAX} steps", least * dt, STEPS_MAX * dt)
    return steps


def _riding(riding: Riding, dt: float) -> dict[str, int]:
    return {
        "wheels.lost_steps": _steps("riding.lost_s", riding.lost_s, dt, 1),
        "wheels.absent_steps": _steps("riding.absent_s", riding.absent_s, dt, 1),
        "wheels.stopping_steps": _steps("riding.stopping_s", riding.stopping_s, dt, 0),
        "wheels.up_turn_q32": _word("riding.up_deg", riding.up_deg, riding.up_deg / TURN * 2**32, 1 << 31),
    }


def _watching(watching: Watching, dt: float) -> dict[str, int]:
    tau_s, apart_mps, rocked = watching.apart_tau_s, watching.apart_mps, watching.rocked_deg / TURN / dt * 2**28
    if tau_s <= 0:
        refuse("watching.apart_tau_s", tau_s, "more than 0", 0.0)
    return {
        "wheels.felt_mps_q26": min(round(math.tau * G_MPS2 * dt * 2**26), 1 << 30),
        "wheels.apart_alpha_q31": _word("watching.apart_tau_s", tau_s, -math.expm1(-dt / tau_s) * 2**31, 1 << 30),
        "wheels.apart_max_mps_q26": _word("watching.apart_mps", apart_mps, apart_mps * 2**26, 1 << 30),
        "wheels.dead_steps": _steps("watching.dead_s", watching.dead_s, dt, 2),
        "wheels.rocked_turnps_q28": _word("watching.rocked_deg", watching.rocked_deg, rocked, (1 << 30) - 1),
        "wheels.full_steps": _steps("watching.full_s", watching.full_s, dt, 1),
        "wheels.still_steps": _steps("watching.still_s", watching.still_s, dt, 1),
    }


def _tau_s(alpha_q31: int, dt: float) -> float:
    return -dt / math.log1p(-alpha_q31 / 2**31) if alpha_q31 else 1e9


def dequantise(params: ControlParams) -> WheelsTuning:
    """The tuning that the integers represent."""
    p, dt = params.values, params.period_s
    balance = balancer.dequantise(params)
    # An encoder's count is that of one wheel; balance counts both. The track is what the two ways of a count leave.
    count_m = 2.0 * balance.wheel.edge_m
    per_count = p["wheels.count_turnps_q28"] / 2**28 * math.tau
    return WheelsTuning(
        period_us=balance.period_us,
        balance=balance,
        turning=Turning(
            count_m=count_m,
            track_m=count_m / dt / per_count if per_count else math.inf,
            rate_max_dps=p["wheels.turn_max_turnps_q28"] / 2**28 * TURN,
            kp_per_dps=p["turn.kp_q29"] / 2**29 / TURN,
            ki_per_deg=p["turn.ki_dt_q35"] / 2**35 / dt / TURN,
            kd_per_dps2=p["turn.kd_q28"] / 2**28 / TURN * dt,
            ff_per_dps=p["turn.ff_q29"] / 2**29 / TURN,
            integral_max=p["wheels.integral_max_q30"] / 2**30,
            duty_max=p["wheels.turn_duty_max_q15"] / 2**15,
            bias_tau_s=_tau_s(p["wheels.bias_alpha_q31"], dt),
            doubt_dps=p["wheels.doubt_turnps_q28"] / 2**28 * TURN,
            slip_dps=p["wheels.slip_turnps_q28"] / 2**28 * TURN,
            slip_s=p["wheels.slip_hold"] * dt,
            slip_mps=p["wheels.slip_mps_q26"] / 2**26,
            wheels_max_dps=p["wheels.counts_max"] * abs(p["wheels.count_turnps_q28"]) / 2**28 * TURN,
        ),
        riding=Riding(
            absent_s=p["wheels.absent_steps"] * dt,
            stopping_s=p["wheels.stopping_steps"] * dt,
            up_deg=p["wheels.up_turn_q32"] / 2**32 * TURN,
            lost_s=p["wheels.lost_steps"] * dt,
        ),
        watching=Watching(
            apart_mps=p["wheels.apart_max_mps_q26"] / 2**26,
            apart_tau_s=_tau_s(p["wheels.apart_alpha_q31"], dt),
            dead_s=p["wheels.dead_steps"] * dt,
            rocked_deg=p["wheels.rocked_turnps_q28"] / 2**28 * dt * TURN,
            full_s=p["wheels.full_steps"] * dt,
            still_s=p["wheels.still_steps"] * dt,
        ),
        exact_period_s=balance.exact_period_s,
    )
