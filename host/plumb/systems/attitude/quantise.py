"""Quantise the tuning of `attitude`, and back.

The filter's unit of a bias is 1/4 rad/s, of a scale error 1/64, of a tilt 1 rad and of a velocity 2 g s, so that all
standard deviations fit one format (docs/reference/arithmetic/attitude.md).
"""

from __future__ import annotations

import math
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.systems.attitude.settings import Aid, Gyro, Motion, Rest
from plumb.systems.attitude.tuning import AttitudeTuning, Mounting
from plumb.tuning import mounting
from plumb.tuning.groups import channel_of, channel_words
from plumb.tuning.whole import check_numbers, not_negative, refuse, whole

DEG = math.pi / 180.0
G_MPS2 = 9.80665
BIAS_UNITS, SCALE_UNITS = 4.0, 64.0
"""Units of the filter in 1 rad/s of bias and in a scale error of 1."""
SPEED_UNITS = 1.0 / (2.0 * G_MPS2)
"""Units of the filter in 1 m/s."""
Q32, Q33 = 1 << 32, 1 << 33
LEAST_STEPS, MOST_STEPS = 15, 125
LONGEST_BLOCK_S = Fraction(318, 1000)
"""A block is shorter than this."""
VARIANCE_MAX = 858993459
"""0.2, Q32: largest variance before the first sample."""
MOST = (1 << 31) - 1
TOLERANCE = 1e-3
"""Largest distance of an integer from the setting's square, relative."""
NEVER = 0.25
"""Stands for a share of 0 in a time constant: it is quantised to 0 again."""
PERIODS_US = (1_000, 21_000)
HOVER_MAX_Q15 = 27853
"""Largest thrust command of a hover, 0.85."""
DRAG_PER_S = (1 / 64, 16.0)
"""Drag of rotors by mass: what the integer of its inverse can say."""


def quantise(tuning: AttitudeTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    check_numbers(tuning)
    if not PERIODS_US[0] <= tuning.period_us <= PERIODS_US[1]:
        reason = f"the attitude's steps take {PERIODS_US[0]} to {PERIODS_US[1]} us"
        refuse("period_us", tuning.period_us, reason, *PERIODS_US)
    dt = Fraction(int(tuning.period_us), 10**6)
    if tuning.block_s <= 0:
        refuse("block_s", tuning.block_s, "give more than 0", 0.0)
    steps = max(round(Fraction(tuning.block_s) / dt), LEAST_STEPS)
    if steps > MOST_STEPS or steps * dt >= LONGEST_BLOCK_S:
        limits = f"a block has at most {MOST_STEPS} samples and less than {float(LONGEST_BLOCK_S)} s"
        longest = min(MOST_STEPS, math.ceil(LONGEST_BLOCK_S / dt) - 1)
        refuse("block_s", tuning.block_s, limits, 0.0, float(longest * dt))
    block_s = float(steps * dt)
    mountings = {
        **mounting.mounting_words("gyro_mounting", tuning.gyro_mounting.matrix),
        **mounting.mounting_words("accel_mounting", tuning.accel_mounting.matrix),
    }
    turned = [mounting.is_turned(mounting.matrix_of(mountings, group)) for group in ("gyro_mounting", "accel_mounting")]
    own = {
        **channel_words("gyro", tuning.gyro, Fraction(1 << 28, 360)),
        **channel_words("accel", tuning.accel, Fraction(1 << 26)),
        **mountings,
        "attitude.dt_s_q33": round(dt * Q33),
        "attitude.half_angle": round(Fraction(math.pi) * dt * 4 * Q32),
        "attitude.block_steps": steps,
        "attitude.inverse_block_q32": round(Fraction(Q32, steps)),
        "attitude.rest_gain_q20": round((1 << 20) / (2 * dt)),
        "attitude.mounted": int(any(turned)),
        **_gyro(tuning.errors, float(dt), block_s),
        **_travel(tuning, float(dt), block_s),
        **_motion(tuning.motion, block_s),
        **_rest(tuning.rest, float(dt), steps),
        **_aid(tuning.aid),
    }
    return ControlParams.of("attitude", own)


def _word(name: str, asked: float, value: float, high: int = MOST, low: int = 0) -> int:
    not_negative({name: asked})
    if math.isinf(value):
        refuse(name, asked, "too large for its integer", 0.0)
    return whole(name, asked, Fraction(value), low, high)


def _square(name: str, sigma: float, units: float, low: int = 1, high: int = VARIANCE_MAX, weight: float = 1.0) -> int:
    """weight (sigma * units)^2, Q32; a refusal names the limit in the unit of sigma."""

    def limit(word: int) -> float:
        return math.sqrt(word / (Q32 * weight)) / units

    _within(name, sigma, limit(high))
    if not sigma and low:
        refuse(name, sigma, "give more than 0", 0.0)
    x = sigma * units
    value = weight * (x * x) * Q32  # a product: the power of a C library is not rounded alike everywhere
    if value < low and low > 1:
        least = limit(low)
        refuse(name, sigma, f"too small for its integer, the least is {least:.6g}", least, limit(high))
    nearest = min(max(round(value), low), high)
    if abs(nearest - value) > value * TOLERANCE:
        coarse = limit(500)
        refuse(name, sigma, f"too fine for its integer: ask for at least {coarse:.3g}", coarse, limit(high))
    return nearest


def _growth(name: str, sigma: float, units: float, seconds: float, high: int) -> int:
    """The growth of a variance in `seconds`, Q32, as near as its integer comes: 0 below half of one."""
    _within(name, sigma, math.sqrt(high / Q32 / seconds) / units)
    x = sigma * units
    return min(round(x * x * seconds * Q32), high)


def _within(name: str, sigma: float, most: float) -> None:
    """Refuse what has no square in its integer. The tolerance lets the largest integer come back from its own sigma."""
    not_negative({name: sigma})
    if sigma > most * (1 + TOLERANCE / 4):
        refuse(name, sigma, f"too large for its integer, the most is {most:.6g}", 0.0, most)


def _gyro(e: Gyro, dt: float, block_s: float) -> dict[str, int]:
    return {
        "attitude.start_bias": _square("errors.bias_dps", e.bias_dps, BIAS_UNITS * DEG),
        "attitude.start_scale": _square("errors.scale", e.scale, SCALE_UNITS),
        "attitude.q_bias": _growth("errors.bias_walk_dps", e.bias_walk_dps, BIAS_UNITS * DEG, block_s, 1 << 24),
        "attitude.q_scale": _growth("errors.scale_walk", e.scale_walk, SCALE_UNITS, block_s, 1 << 20),
        "attitude.q_tilt": _growth("errors.noise_dps", e.noise_dps, DEG, block_s, 1 << 26),
        "attitude.q_turn_q24": _square("errors.turn_noise", e.turn_noise, 1.0, 0, 1 << 30, 4 / dt),
        "attitude.q_clipped": _growth("errors.clipped_deg", e.clipped_deg, DEG, 1.0, 1 << 27),
    }


def _pass(name: str, seconds: float, least: int, block_s: float) -> int:
    """The share of a block in a time, Q32. The time has at least so many blocks."""
    if seconds < least * block_s:
        refuse(name, seconds, f"at least {least} blocks, {least * block_s:g} s", least * block_s)
    return round(block_s / seconds * Q32)


def _motion(m: Motion, block_s: float) -> dict[str, int]:
    return {
        "attitude.velocity_pass_q32": _pass("motion.pass_s", m.pass_s, 3, block_s),
        "attitude.leak_q32": _pass("motion.leak_s", m.leak_s, 4, block_s),
        "attitude.start_tilt": _square("motion.start_tilt_deg", m.start_tilt_deg, DEG),
        "attitude.start_speed": _square("motion.start_velocity_mps", m.start_velocity_mps, SPEED_UNITS),
        "attitude.speed_min": _square("motion.velocity_mps", m.velocity_mps, 1 / G_MPS2, 1 << 8, weight=1 / 64),
        "attitude.velocity_share_q16": _word("motion.share", m.share, m.share * (1 << 16), 1 << 20),
        "attitude.unsure": _square("motion.unsure_deg", m.unsure_deg, DEG, 0, Q32 - 1, 2.0),
    }


def _travel(tuning: AttitudeTuning, dt: float, block_s: float) -> dict[str, int]:
    """A velocity is one error for as long as it lasts, not a new one every block: so much larger is its variance."""
    m = tuning.motion
    gain = 2.0 * m.travel_s / block_s
    return {
        "attitude.travel_pass_q32": _pass("motion.travel_s", m.travel_s, 4, block_s),
        "attitude.travel_least_q24": _square("motion.travel_mps", m.travel_mps, 1 / G_MPS2, 0, 1 << 29, 2.0**-8),
        "attitude.travel_gain_q16": _word("motion.travel_s", m.travel_s, gain * (1 << 16), 1 << 26),
        "attitude.doubt_q24": _square(
            "errors.turn_doubt", tuning.errors.turn_doubt, G_MPS2, 0, 1 << 30, 4 / dt * 2.0**-8
        ),
    }


def _aid(aid: Aid) -> dict[str, int]:
    not_negative({"aid.drag_per_s": aid.drag_per_s})
    if aid.drag_per_s and not DRAG_PER_S[0] <= aid.drag_per_s <= DRAG_PER_S[1]:
        refuse("aid.drag_per_s", aid.drag_per_s, f"0, or {DRAG_PER_S[0]:g} to {DRAG_PER_S[1]:g}", *DRAG_PER_S)
    inverse = (1 << 24) / aid.drag_per_s if aid.drag_per_s else 0.0
    return {
        "attitude.aid_s_q24": _word("aid.drag_per_s", aid.drag_per_s, inverse, 1 << 30),
        "attitude.aid_variance": _square("aid.velocity_mps", aid.velocity_mps, 1 / G_MPS2, 1 << 8, weight=1 / 64),
        "attitude.aid_hover_q15": _word("aid.hover", aid.hover, aid.hover * (1 << 15), HOVER_MAX_Q15),
    }


def _blocks(name: str, seconds: float, block_s: float) -> int:
    if seconds <= 0:
        refuse(name, seconds, "give more than 0", 0.0)
    if seconds / block_s >= 255.5:
        refuse(name, seconds, f"at most {255 * block_s:g} s", 0.0, 255 * block_s)
    return max(round(seconds / block_s), 1)


def _rest(r: Rest, dt: float, steps: int) -> dict[str, int]:
    block_s = steps * dt
    return {
        "attitude.rest_gyro": _word("rest.gyro_dps", r.gyro_dps, r.gyro_dps * DEG * dt / 2 * Q32),
        "attitude.rest_turn": _word("rest.turn_dps", r.turn_dps, r.turn_dps * DEG * block_s / 2 * Q32),
        "attitude.rest_accel": _word("rest.accel_g", r.accel_g, r.accel_g * steps * (1 << 18)),
        "attitude.rest_blocks": _blocks("rest.seconds", r.seconds, block_s),
        "attitude.rest_variance": _square("rest.noise_dps", r.noise_dps, BIAS_UNITS * DEG, 1 << 8),
    }


def dequantise(params: ControlParams) -> AttitudeTuning:
    """The tuning that the integers represent."""
    p = {name.removeprefix("attitude."): value for name, value in params.values.items()}
    dt, steps = params.period_s, p["block_steps"]
    block_s = steps * dt

    def sigma(name: str, units: float, seconds: float = 1.0) -> float:
        return math.sqrt(p[name] / Q32 / seconds) / units

    errors = Gyro(
        bias_dps=sigma("start_bias", BIAS_UNITS * DEG),
        scale=sigma("start_scale", SCALE_UNITS),
        bias_walk_dps=sigma("q_bias", BIAS_UNITS * DEG, block_s),
        noise_dps=sigma("q_tilt", DEG, block_s),
        turn_noise=math.sqrt(p["q_turn_q24"] / Q32 * dt / 4),
        scale_walk=sigma("q_scale", SCALE_UNITS, block_s),
        clipped_deg=sigma("q_clipped", DEG),
        turn_doubt=math.sqrt(p["doubt_q24"] / 2**24 * dt / 4) / G_MPS2,
    )
    motion = Motion(
        velocity_mps=math.sqrt(p["speed_min"] / 2**26) * G_MPS2,
        share=p["velocity_share_q16"] / (1 << 16),
        pass_s=block_s / (p["velocity_pass_q32"] or NEVER) * Q32,
        leak_s=block_s / (p["leak_q32"] or NEVER) * Q32,
        start_tilt_deg=sigma("start_tilt", DEG),
        start_velocity_mps=sigma("start_speed", SPEED_UNITS),
        travel_mps=math.sqrt(p["travel_least_q24"] / 2**24) * G_MPS2,
        travel_s=block_s / (p["travel_pass_q32"] or NEVER) * Q32,
        unsure_deg=math.sqrt(p["unsure"] / 2 / Q32) / DEG,
    )
    rest = Rest(
        gyro_dps=p["rest_gyro"] / Q32 * 2 / dt / DEG,
        accel_g=p["rest_accel"] / steps / (1 << 18),
        turn_dps=p["rest_turn"] / Q32 * 2 / block_s / DEG,
        seconds=p["rest_blocks"] * block_s,
        noise_dps=sigma("rest_variance", BIAS_UNITS * DEG),
    )
    aid = Aid(
        drag_per_s=(1 << 24) / p["aid_s_q24"] if p["aid_s_q24"] else 0.0,
        velocity_mps=math.sqrt(p["aid_variance"] / 2**26) * G_MPS2,
        hover=p["aid_hover_q15"] / (1 << 15),
    )
    return AttitudeTuning(
        period_us=round(dt * 1e6),
        gyro=channel_of(params, "gyro", 2**28 / 360),
        accel=channel_of(params, "accel", 2**26),
        gyro_mounting=Mounting.of(mounting.matrix_of(params.values, "gyro_mounting").tolist()),
        accel_mounting=Mounting.of(mounting.matrix_of(params.values, "accel_mounting").tolist()),
        errors=errors,
        motion=motion,
        rest=rest,
        aid=aid,
        block_s=block_s,
        exact_period_s=dt,
    )
