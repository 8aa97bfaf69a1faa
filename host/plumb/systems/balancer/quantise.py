"""Quantise the tuning of `balancer`, and back."""

from __future__ import annotations

import math
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.systems.balancer.reference import GRAVITY_MPS2
from plumb.systems.balancer.tuning import EDGES_MOST, SPEED_MOST_MPS, BalancerTuning, Drive, SpeedLoop, Wheel
from plumb.tuning.groups import axis_of, axis_words, not_negative, refuse, whole
from plumb.tuning.variances import in_variances

WHEEL_SPEED_LIMIT = int(SPEED_MOST_MPS) << 26
MOST = (1 << 31) - 1


def quantise(tuning: BalancerTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    shared, lsb_deg2 = axis_words(tuning)
    own = {
        **shared,
        **_wheel(tuning.wheel, Fraction(int(tuning.period_us), 10**6)),
        **_speed(tuning.speed, Fraction(int(tuning.period_us), 10**6)),
        **_drive(tuning.drive, tuning.speed),
    }
    return ControlParams.of("balancer", own, in_variances(float(lsb_deg2)))


def _share(name: str, tau_s: float, dt: Fraction) -> Fraction:
    """Coefficient of a first-order filter: 1 - exp(-dt / tau)."""
    not_negative({name: tau_s})
    share = Fraction(-math.expm1(-float(dt) / tau_s)) if tau_s else Fraction(1)
    if share * (1 << 31) < 500:
        refuse(name, tau_s, f"too slow, the most is {float(dt) * 2**31 / 500:.3g}", 0.0, float(dt) * 2**31 / 500)
    return share


def _wheel(wheel: Wheel, dt: Fraction) -> dict[str, int]:
    limit = WHEEL_SPEED_LIMIT
    edge = whole("wheel.edge_m", wheel.edge_m, Fraction(wheel.edge_m) / dt * (1 << 26), -limit, limit)
    edges, most = wheel.edges_max, min(limit // abs(edge) if edge else EDGES_MOST, EDGES_MOST)
    if not 0 <= edges <= most or edges != int(edges):
        reason = f"whole edges up to {most}, which are 15 m/s at this period; 0 takes as many"
        refuse("wheel.edges_max", edges, reason, 0, most)
    share = _share("wheel.tau_s", wheel.tau_s, dt)
    not_negative({"wheel.accel_share": wheel.accel_share})
    gain = Fraction(wheel.accel_share) * share / dt / Fraction(GRAVITY_MPS2) * (1 << 30)
    return {
        "wheel.edges_max": int(edges) or most,
        "wheel.edge_mps_q26": edge,
        "wheel.alpha_q31": whole("wheel.tau_s", wheel.tau_s, share * (1 << 31), 0, MOST),
        "wheel.accel_gain_q30": whole("wheel.accel_share", wheel.accel_share, gain, 0, MOST),
    }


def _speed(speed: SpeedLoop, dt: Fraction) -> dict[str, int]:
    """The words of the speed loop, a PID whose error is in m/s Q26, whose rate is in g Q26, and whose command is a
    fraction of the largest lean."""
    lean_max, limit = Fraction(speed.lean_max_deg), 1 << 30
    if not 0 < lean_max <= Fraction(45, 2):
        refuse("speed.lean_max_deg", speed.lean_max_deg, "leans are more than 0 and at most 22.5 deg", 0.0, 22.5)

    def word(name: str, scale: Fraction | int, low: int, high: int) -> int:
        asked = float(getattr(speed, name))
        return whole(f"speed.{name}", asked, Fraction(asked) / lean_max * scale, low, high)

    slew = min(Fraction(speed.lean_slew_dps) / lean_max * dt, Fraction(2)) * (1 << 22)
    if slew <= 0:
        refuse("speed.lean_slew_dps", speed.lean_slew_dps, "the lean could never change", 0.0, math.inf)
    share = _share("speed.accel_tau_s", speed.accel_tau_s, dt)
    return {
        "speed.kp_q22": word("lean_deg_per_mps", 1 << 28, -limit, limit),
        "speed.ki_dt_q22": word("lean_deg_per_m", (1 << 28) * dt, 0, MOST),
        "speed.kd_q27": word("lean_deg_per_g", 1 << 29, -limit, limit),
        "speed.d_alpha_q31": whole("speed.accel_tau_s", speed.accel_tau_s, share * (1 << 31), 0, MOST),
        "speed.slew_q22": whole("speed.lean_slew_dps", speed.lean_slew_dps, slew, 1, 1 << 23),
    }


def _drive(drive: Drive, speed: SpeedLoop) -> dict[str, int]:
    not_negative({"drive.duty_max": drive.duty_max, "drive.fall_deg": drive.fall_deg})

    def word(name: str, asked: float, scale: Fraction | int, low: int, high: int) -> int:
        return whole(name, asked, Fraction(asked) * scale, low, high)

    return {
        "drive.speed_max_mps_q26": word("speed.speed_max_mps", speed.speed_max_mps, 1 << 26, 0, 8 << 26),
        "drive.lean_max_turn_q34": word("speed.lean_max_deg", speed.lean_max_deg, Fraction(1 << 34, 360), 1, 1 << 30),
        "drive.span_q15": word("drive.span", drive.span, 1 << 15, -32767, 32767),
        "drive.duty_max_q15": word("drive.duty_max", drive.duty_max, 1 << 15, 0, 32767),
        "drive.fall_turn_q32": word("drive.fall_deg", drive.fall_deg, Fraction(1 << 32, 360), 0, 1 << 31),
    }


def dequantise(params: ControlParams) -> BalancerTuning:
    """The tuning that the integers represent."""
    dt, p = params.period_s, params.values
    share = p["wheel.alpha_q31"] / 2**31
    lean_max_deg = p["drive.lean_max_turn_q34"] / 2**34 * 360
    damping = p["speed.d_alpha_q31"] / 2**31
    return BalancerTuning(
        **axis_of(params),
        wheel=Wheel(
            edge_m=p["wheel.edge_mps_q26"] / 2**26 * dt,
            edges_max=p["wheel.edges_max"],
            tau_s=0.0 if p["wheel.alpha_q31"] == MOST else -dt / math.log1p(-share),
            accel_share=p["wheel.accel_gain_q30"] / 2**30 * dt * GRAVITY_MPS2 / share if share else 0.0,
        ),
        speed=SpeedLoop(
            lean_deg_per_mps=p["speed.kp_q22"] / 2**28 * lean_max_deg,
            lean_deg_per_m=p["speed.ki_dt_q22"] / 2**28 / dt * lean_max_deg,
            lean_deg_per_g=p["speed.kd_q27"] / 2**29 * lean_max_deg,
            accel_tau_s=0.0 if p["speed.d_alpha_q31"] == MOST else -dt / math.log1p(-damping),
            lean_max_deg=lean_max_deg,
            lean_slew_dps=p["speed.slew_q22"] / 2**22 / dt * lean_max_deg,
            speed_max_mps=p["drive.speed_max_mps_q26"] / 2**26,
        ),
        drive=Drive(
            p["drive.span_q15"] / 2**15, p["drive.duty_max_q15"] / 2**15, p["drive.fall_turn_q32"] / 2**32 * 360
        ),
    )
