"""A body that turns and moves as prescribed, felt by an ideal sensor of 16 bits, and what `attitude` makes of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.spec.tuning import Channel
from plumb.systems.attitude.quantise import quantise
from plumb.systems.attitude.tuning import AttitudeTuning

PERIOD_US, MISSING_COUNT = 4000, -32768
PERIOD_S = PERIOD_US * 1e-6
UNIT_DPS, UNIT_G = 2000.0 / 32768, 16.0 / 32768
BLOCK_S = 0.12
UP = np.array([0.0, 0.0, 1.0])
FLAGS = {flag.name: 1 << bit for bit, flag in enumerate(declarations.system("attitude").flags)}


def steps(seconds: float) -> int:
    return round(seconds / PERIOD_S)


def quaternion_product(p: FloatArray, q: FloatArray) -> FloatArray:
    w, v = p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([w, *v])


def earth_to_body(q: FloatArray) -> FloatArray:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def felt(rate_dps: FloatArray, moved_g: FloatArray) -> tuple[npt.NDArray[np.int16], FloatArray]:
    """Counts (n, 6) and the vertical in body axes after each step (n, 3) of a body that starts level. rate_dps: in body
    axes; moved_g: acceleration in earth axes, both (n, 3)."""
    q, raw, up = np.array([1.0, 0.0, 0.0, 0.0]), np.empty((len(rate_dps), 6)), np.empty((len(rate_dps), 3))
    for k, (rate, moved) in enumerate(zip(np.radians(rate_dps), moved_g, strict=True)):
        angle = rate * PERIOD_S / 4
        half = np.linalg.norm(angle)
        quarter_turn = np.array([np.cos(half), *(angle * np.sinc(half / np.pi))])
        q = quaternion_product(q, quarter_turn)  # the middle of the step
        force = earth_to_body(q) @ (moved + UP)
        q = quaternion_product(q, quarter_turn)
        raw[k], up[k] = [*(np.degrees(rate) / UNIT_DPS), *(force / UNIT_G)], earth_to_body(q)[:, 2]
    return np.clip(np.rint(raw), -32767, 32767).astype(np.int16), up


def tuning_of(limit_dps: float = 2000.0, period_us: int = PERIOD_US) -> AttitudeTuning:
    most = min(round(limit_dps / UNIT_DPS), 32767)
    return AttitudeTuning(
        period_us,
        Channel(zero_counts=0.0, unit_per_count=UNIT_DPS, min_counts=-most, max_counts=most),
        Channel(zero_counts=0.0, unit_per_count=UNIT_G, min_counts=-32766, max_counts=32766),
    )


def run(raw: npt.NDArray[np.int16], limit_dps: float = 2000.0, period_us: int = PERIOD_US) -> Words:
    return native_core.run_control(quantise(tuning_of(limit_dps, period_us)), raw, np.zeros(len(raw), np.int32))


def error_deg(words: Words, up: FloatArray) -> FloatArray:
    found = np.stack([words[f"up_q30_{axis}"] for axis in range(3)], 1) / 2.0**30
    return np.asarray(
        np.degrees(np.arctan2(np.linalg.norm(np.cross(found, up), axis=1), np.sum(found * up, axis=1))), np.float64
    )


def sigma_deg(words: Words) -> FloatArray:
    """Standard deviation of the tilt as it is stated."""
    return np.asarray(np.degrees(np.sqrt(words["tilt_variance_rad2_q32"] / 2.0**32)), np.float64)


def flagged(words: Words, name: str) -> npt.NDArray[np.bool_]:
    return np.asarray((words["flags"] & FLAGS[name]) != 0)


def still(seconds: float) -> tuple[FloatArray, FloatArray]:
    return np.zeros((steps(seconds), 3)), np.zeros((steps(seconds), 3))


def swing(seconds: float, amplitude_dps: float, hertz: float) -> FloatArray:
    """Rates about x and y, a quarter of a period apart."""
    phase = 2 * np.pi * hertz * PERIOD_S * np.arange(steps(seconds))
    return amplitude_dps * np.stack([np.sin(phase), np.cos(phase), 0 * phase], 1)
