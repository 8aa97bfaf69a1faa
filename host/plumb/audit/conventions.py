"""Which convention a reference follows: what its turns and its vertical say, beside the sensors.

A convention is the order of w, the direction of the turn, the earth axis that points up, the sign of the acceleration,
and a rotation R (24 of them) of the sensors' axes. Both sensors are consistent with each other by then, so that one R
serves both: w = R g, u = s R a. Two figures judge each: the correlation of the rates, and the mean cosine between the
verticals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.audit import mends, signed_axes
from plumb.spec.arrays import BoolArray, FloatArray

BLOCKS = 24
SURE_T = 4.0
CLOSE = 0.02
"""Difference of two scores, of 2 at most, that is none."""
FORMS: tuple[tuple[str, ...], ...] = ((), ("ref:turned",), ("ref:wxyz",), ("ref:wxyz", "ref:turned"))
UPS = ("z", "x", "y")
PROPER = np.array([one for one in signed_axes.EVERY if np.linalg.det(one) > 0.0])
"""(24, 3, 3), the identity first."""


@dataclass(frozen=True)
class Convention:
    """form: mends of order and direction; rotation: R (3, 3); up: earth axis; sign: of the acceleration along it;
    score, as_read: of 2; unique: no other is as good; rates, verticals: correlation and mean cosine."""

    form: tuple[str, ...]
    rotation: FloatArray
    up: str
    sign: int
    score: float
    as_read: float
    unique: bool
    rates: float
    verticals: float


def relative_rates(q: FloatArray, steps: int, step_s: float) -> FloatArray:
    """Mean rate in body axes over `steps` around each of n points, deg/s, of a body-to-earth reference (n, 4); NaN at
    the ends and where it is lost."""
    n, half = len(q), steps // 2
    found = np.full((n, 3), np.nan)
    a, b = q[: n - steps], q[steps:]
    w = np.sum(a * b, axis=1)
    vector = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    sign = np.where(w < 0.0, -1.0, 1.0)
    length = np.linalg.norm(vector, axis=1)
    angle = 2.0 * np.arctan2(length, np.abs(w))
    rate = np.degrees(angle / (steps * step_s))
    found[half : half + n - steps] = vector * (sign * rate / np.maximum(length, 1e-12))[:, None]
    return found


def axes_of_earth(q: FloatArray) -> FloatArray:
    """The earth's x, y and z in body axes, (n, 3, 3): [:, e] is axis e."""
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, 1) for row in rows], 1)


def convention_of(
    q: FloatArray, gyr_dps: FloatArray, acc_g: FloatArray, usable: BoolArray, step_s: float
) -> Convention | None:
    """The convention that fits best, and as read where that is not told from it. q (n, 4) unit, NaN where lost. None
    for too little of it."""
    steps = max(2, 2 * round(0.02 / step_s))
    rate = _means(gyr_dps, steps)
    length = np.linalg.norm(acc_g, axis=1)
    u = acc_g / np.maximum(length, 1e-9)[:, None]
    weight = 1.0 / (1.0 + ((length - 1.0) / 0.2) ** 2) ** 2
    found = [_of_form(q, form, rate, u, weight, usable, steps, step_s) for form in FORMS]
    if any(one is None for one in found):
        return None
    tables = np.array([one for one in found if one is not None])
    scores = tables.mean(axis=-1)
    place = np.unravel_index(int(np.argmax(scores)), scores.shape)
    best = tables[place]
    costs = _costs()
    tied = [
        other
        for other in zip(*np.nonzero(scores >= scores[place] - 0.3), strict=True)
        if scores[other] >= scores[place] - CLOSE or _t(best - tables[other]) < SURE_T
    ]
    chosen = min(tied, key=lambda one: (costs[one], -scores[one]))
    level = [one for one in tied if costs[one] <= costs[chosen]]
    form, turn, up, sign = (int(one) for one in chosen)
    verticals = _verticals(q, FORMS[form], turn, up, u, weight, usable)
    return Convention(
        FORMS[form],
        PROPER[turn],
        UPS[up],
        1 if sign == 0 else -1,
        float(scores[chosen]),
        float(scores[0, 0, 0, 0]),
        len(level) == 1,
        float(scores[chosen]) - verticals * (1.0 if sign == 0 else -1.0),
        verticals * (1.0 if sign == 0 else -1.0),
    )


def _of_form(
    q: FloatArray,
    form: tuple[str, ...],
    rate: FloatArray,
    u: FloatArray,
    weight: FloatArray,
    usable: BoolArray,
    steps: int,
    step_s: float,
) -> FloatArray | None:
    """Scores (24 rotations, 3 axes up, 2 signs, BLOCKS)."""
    for mend in form:
        q = mends.reference(q, mend)
    own = relative_rates(q, steps, step_s)
    good = usable & np.isfinite(own).all(1) & np.isfinite(rate).all(1) & np.isfinite(q).all(1)
    if np.sum(good) < 8 * BLOCKS:
        return None
    own, rate, u, weight = own[good], rate[good], u[good], weight[good]
    size = len(own) // BLOCKS

    def blocks(products: FloatArray) -> FloatArray:
        return np.asarray(products[: size * BLOCKS].reshape(BLOCKS, size, *products.shape[1:]).mean(1), np.float64)

    power = np.sqrt(np.mean(np.sum(own**2, axis=1)) * np.mean(np.sum(rate**2, axis=1)))
    turned = blocks(own[:, :, None] * rate[:, None, :]) / max(float(power), 1e-9)
    earth = axes_of_earth(q[good])
    lengths = weight[:, None, None] / max(float(np.mean(weight)), 1e-9)
    found = np.zeros((len(PROPER), len(UPS), 2, BLOCKS))
    rates = np.einsum("rij,kij->rk", PROPER, turned)
    for place, axis in enumerate(UPS):
        aligned = blocks(earth[:, "xyz".index(axis), :, None] * u[:, None, :] * lengths)
        cosines = np.einsum("rij,kij->rk", PROPER, aligned)
        found[:, place, 0], found[:, place, 1] = rates + cosines, rates - cosines
    return found


def _verticals(
    q: FloatArray, form: tuple[str, ...], turn: int, up: int, u: FloatArray, weight: FloatArray, usable: BoolArray
) -> float:
    for mend in form:
        q = mends.reference(q, mend)
    good = usable & np.isfinite(q).all(1)
    vertical = axes_of_earth(q[good])[:, "xyz".index(UPS[up])]
    cosines = np.sum(vertical * (u[good] @ PROPER[turn].T), axis=1)
    return float(np.sum(cosines * weight[good]) / max(float(np.sum(weight[good])), 1e-9))


def _costs() -> FloatArray:
    """How much each convention is away from that of the format: (forms, rotations, axes up, signs)."""
    forms = np.array([len(form) for form in FORMS], np.float64)
    turns = np.array([float(np.any(one != np.eye(3))) * 1.5 for one in PROPER])
    ups = np.array([0.0, 1.2, 1.2])
    signs = np.array([0.0, 1.0])
    return np.asarray(
        forms[:, None, None, None] + turns[None, :, None, None] + ups[None, None, :, None] + signs, np.float64
    )


def _means(values: FloatArray, steps: int) -> FloatArray:
    """Means over `steps` steps around each point, NaN at the ends."""
    middles = 0.5 * (values[1:] + values[:-1])
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(middles, axis=0)])
    found = np.full(values.shape, np.nan)
    half = steps // 2
    found[half : half + len(values) - steps] = (total[steps:] - total[:-steps]) / steps
    return found


def _t(difference: FloatArray) -> float:
    spread = float(np.std(difference, ddof=1)) / np.sqrt(len(difference))
    return float(np.mean(difference) / max(spread, 1e-12))
