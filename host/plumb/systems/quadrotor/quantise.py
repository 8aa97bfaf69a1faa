"""Quantise the tuning of `quadrotor`, and back."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.systems.attitude import quantise as attitude
from plumb.systems.attitude.quantise import G_MPS2
from plumb.systems.quadrotor.tuning import Level, Mixer, QuadrotorTuning, RateGains, Rates, Receiver, Stops
from plumb.tuning.groups import esc_of, esc_words, refuse, whole

GROUPS = ("gyro", "accel", "gyro_mounting", "accel_mounting", "attitude")
"""Groups of parameters that are those of attitude."""
MOST = (1 << 31) - 1
TURN = 360.0
STEPS_MAX = 65534
AXES = ("roll", "pitch", "yaw")
LEAN_MAX = 644245094
"""Largest sine of a lean, Q30."""
RATE_MAX, YAW_MAX = 1342177280, 738197504
"""Largest rates that sticks and lean, or yaw, ask for, turn/s Q28."""
GAIN_MAX = 1 << 30
DESCENT_MAX = 1 << 27
"""Fastest descent of a landing, 0.5 g s, Q28."""


def quantise(tuning: QuadrotorTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    estimator = attitude.quantise(replace(tuning.attitude, period_us=tuning.period_us, exact_period_s=None)).values
    dt = tuning.period_us * 1e-6
    rates, mixer = tuning.rates, tuning.mixer
    alpha = -math.expm1(-dt / rates.d_tau_s) if rates.d_tau_s > 0 else 1.0
    own = {
        **{name: value for name, value in estimator.items() if name.split(".")[0] in GROUPS},
        **esc_words(tuning.esc),
        **_level(tuning.level),
        **_receiver(tuning.receiver, dt),
        "quadrotor.stick_rate_q28": _rate("rates.roll_pitch_max_dps", rates.roll_pitch_max_dps, RATE_MAX),
        "quadrotor.yaw_rate_max_q28": _rate("rates.yaw_max_dps", rates.yaw_max_dps, YAW_MAX),
        "quadrotor.d_alpha_q31": min(
            whole("rates.d_tau_s", rates.d_tau_s, Fraction(alpha) * (1 << 31), 0, 1 << 31), MOST
        ),
        "quadrotor.integral_max_q30": _share("rates.integral_max", rates.integral_max, 30, 1 << 30),
        "quadrotor.yaw_max_q24": _share("mixer.yaw_max", mixer.yaw_max, 24, 1 << 24),
        "quadrotor.idle_q24": _share("mixer.idle", mixer.idle, 24, 1 << 22),
        "quadrotor.airmode": _choice("mixer.airmode", mixer.airmode),
        "quadrotor.low_q15": _share("mixer.low", mixer.low, 15, 8192),
        "quadrotor.blind_steps": _steps("stops.blind_s", tuning.stops.blind_s, dt),
        "quadrotor.idle_limit": _steps("stops.idle_s", tuning.stops.idle_s, dt),
        "quadrotor.lying_limit": _steps("stops.lying_s", tuning.stops.lying_s, dt),
        "quadrotor.runaway_limit": _steps("stops.runaway_s", tuning.stops.runaway_s, dt),
        "quadrotor.upturned_limit": _steps("stops.upturned_s", tuning.stops.upturned_s, dt),
    }
    for axis in AXES:
        own.update(_gains(axis, getattr(rates, axis), dt, alpha))
    return ControlParams.of("quadrotor", own)


def _word(name: str, asked: float, value: float, high: int, low: int = 0) -> int:
    if asked < 0:
        refuse(name, asked, "it cannot be negative", 0.0)
    return whole(name, asked, Fraction(value), low, high)


def _rate(name: str, asked_dps: float, most: int) -> int:
    return _word(name, asked_dps, asked_dps / TURN * 2**28, most)


def _share(name: str, asked: float, bits: int, most: int) -> int:
    return _word(name, asked, asked * 2**bits, most)


def _choice(name: str, asked: int) -> int:
    if asked not in (0, 1):
        refuse(name, asked, "0 or 1", 0, 1)
    return asked


def _steps(name: str, seconds: float, dt: float, least: int = 1) -> int:
    """Whole steps, the nearest."""
    steps = round(seconds / dt)
    if not least <= steps <= STEPS_MAX:
        refuse(name, seconds, f"{least} to {STEPS_MAX} steps", least * dt, STEPS_MAX * dt)
    return steps


def _level(level: Level) -> dict[str, int]:
    sine = math.sin(math.radians(level.lean_max_deg))
    if level.lean_max_deg > math.degrees(math.asin(LEAN_MAX / 2**30)):
        refuse("level.lean_max_deg", level.lean_max_deg, "at most 36.8 deg", 0.0, 36.8)
    return {
        "quadrotor.tilt_max_q30": _word("level.lean_max_deg", level.lean_max_deg, sine * 2**30, LEAN_MAX),
        "quadrotor.tilt_gain_q28": _word(
            "level.gain_per_s", level.gain_per_s, level.gain_per_s / math.tau * 2**28, MOST
        ),
        "quadrotor.tilt_rate_max_q28": _rate("level.rate_max_dps", level.rate_max_dps, RATE_MAX),
        "quadrotor.unsure_rate_q28": _rate("level.unsure_rate_max_dps", level.unsure_rate_max_dps, RATE_MAX),
    }


def _receiver(receiver: Receiver, dt: float) -> dict[str, int]:
    return {
        "quadrotor.lost_steps": _steps("receiver.lost_s", receiver.lost_s, dt),
        "quadrotor.held_steps": _steps("receiver.held_s", receiver.held_s, dt, 0),
        "quadrotor.back_steps": _steps("receiver.back_s", receiver.back_s, dt),
        "quadrotor.lost_action": _choice("receiver.lands", receiver.lands),
        "quadrotor.land_gs_q28": _word(
            "receiver.land_mps", receiver.land_mps, receiver.land_mps / G_MPS2 * 2**28, DESCENT_MAX
        ),
        "quadrotor.land_steps": _steps("receiver.land_s", receiver.land_s, dt),
    }


def _gains(axis: str, gains: RateGains, dt: float, alpha: float) -> dict[str, int]:
    """The derivative acts on the rate less its low-pass of the step before: dt / alpha times the filtered slope."""
    name = f"rates.{axis}"
    return {
        f"rate_{axis}.kp_q29": _word(f"{name}.kp_per_dps", gains.kp_per_dps, gains.kp_per_dps * TURN * 2**29, GAIN_MAX),
        f"rate_{axis}.ki_dt_q35": _word(
            f"{name}.ki_per_deg", gains.ki_per_deg, gains.ki_per_deg * TURN * dt * 2**35, MOST
        ),
        f"rate_{axis}.kd_q28": _word(
            f"{name}.kd_per_dps2", gains.kd_per_dps2, gains.kd_per_dps2 * TURN * alpha / dt * 2**28, GAIN_MAX
        ),
        f"rate_{axis}.ff_q29": _word(f"{name}.ff_per_dps", gains.ff_per_dps, gains.ff_per_dps * TURN * 2**29, GAIN_MAX),
    }


def dequantise(params: ControlParams) -> QuadrotorTuning:
    """The tuning that the integers represent."""
    p, dt = {name.removeprefix("quadrotor."): value for name, value in params.values.items()}, params.period_s
    alpha = p["d_alpha_q31"] / 2**31
    estimator = attitude.dequantise(params)
    return QuadrotorTuning(
        period_us=estimator.period_us,
        attitude=estimator,
        rates=Rates(
            **{axis: _gains_of(p, axis, dt, alpha) for axis in AXES},
            roll_pitch_max_dps=p["stick_rate_q28"] / 2**28 * TURN,
            yaw_max_dps=p["yaw_rate_max_q28"] / 2**28 * TURN,
            d_tau_s=-dt / math.log1p(-alpha) if p["d_alpha_q31"] < MOST else 0.0,
            integral_max=p["integral_max_q30"] / 2**30,
        ),
        level=Level(
            lean_max_deg=math.degrees(math.asin(p["tilt_max_q30"] / 2**30)),
            gain_per_s=p["tilt_gain_q28"] / 2**28 * math.tau,
            rate_max_dps=p["tilt_rate_max_q28"] / 2**28 * TURN,
            unsure_rate_max_dps=p["unsure_rate_q28"] / 2**28 * TURN,
        ),
        mixer=Mixer(p["idle_q24"] / 2**24, p["yaw_max_q24"] / 2**24, p["airmode"], p["low_q15"] / 2**15),
        receiver=Receiver(
            lost_s=p["lost_steps"] * dt,
            held_s=p["held_steps"] * dt,
            back_s=p["back_steps"] * dt,
            lands=p["lost_action"],
            land_mps=p["land_gs_q28"] / 2**28 * G_MPS2,
            land_s=p["land_steps"] * dt,
        ),
        stops=Stops(
            blind_s=p["blind_steps"] * dt,
            idle_s=p["idle_limit"] * dt,
            lying_s=p["lying_limit"] * dt,
            runaway_s=p["runaway_limit"] * dt,
            upturned_s=p["upturned_limit"] * dt,
        ),
        esc=esc_of(params),
        exact_period_s=estimator.exact_period_s,
    )


def _gains_of(p: dict[str, int], axis: str, dt: float, alpha: float) -> RateGains:
    group = f"rate_{axis}."
    return RateGains(
        kp_per_dps=p[group + "kp_q29"] / 2**29 / TURN,
        ki_per_deg=p[group + "ki_dt_q35"] / 2**35 / dt / TURN,
        kd_per_dps2=p[group + "kd_q28"] / 2**28 / TURN * dt / alpha if alpha else 0.0,
        ff_per_dps=p[group + "ff_q29"] / 2**29 / TURN,
    )
