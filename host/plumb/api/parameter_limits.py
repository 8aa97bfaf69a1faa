"""The smallest and the largest value that a parameter may be written to, found by asking what is accepted.

Limits of a parameter depend on the others (a minimum below its maximum, variances in one unit, what the core's
formats hold), and no formula says them all. A refusal does.
"""

from __future__ import annotations

import math
from collections.abc import Callable

Held = Callable[[float | int], float | int | None]
"""Value to be written -> the value that the board would then have; None where it is refused."""

GROWTH = 16
"""Between two candidates while a refused one is sought. Every range of accepted values that does not hold the present
value is wider than that."""
LARGEST, SMALLEST = 1e12, 1e-18
"""Range of the candidates' magnitudes. Where the largest is accepted there is no limit."""
HALVINGS = 40
"""Halvings of the distance between an accepted and a refused candidate: to less than a step of any 32-bit integer."""

SAME = 2e-3
"""Relative distance between what is written and what is held, and a little more."""


def float_limits(value: float, held: Held) -> tuple[float, float]:
    """Smallest and largest value, as the board would hold them. value: the present one, which is accepted."""
    return 0.0 - _largest(-value, lambda v: _negated(held(-v))), _largest(value, held)


def int_limits(value: int, low: int, high: int, held: Held) -> tuple[int, int]:
    """The same for whole numbers, from low to high at most."""
    return _last_int(value, low, held), _last_int(value, high, held)


def _negated(value: float | int | None) -> float | None:
    return None if value is None else -value


def _largest(value: float, held: Held) -> float:
    accepted = value
    if value <= 0.0:
        accepted = LARGEST
        while held(accepted) is None:
            accepted /= GROWTH
            if accepted < SMALLEST:
                return 0.0 if held(0.0) is not None else _between(value, 0.0, held)
    refused = accepted
    while held(refused) is not None:
        if refused >= LARGEST:
            return math.inf
        accepted, refused = refused, min(refused * GROWTH, LARGEST)
    return _between(accepted, refused, held)


def _between(accepted: float, refused: float, held: Held) -> float:
    """The value that the board holds for the last accepted one on the way to a refused one."""
    for _ in range(HALVINGS):
        middle = (accepted + refused) / 2.0
        if held(middle) is None:
            refused = middle
        else:
            accepted = middle
    last = held(accepted)  # an angle of half a turn may be held as that of the other sign
    assert last is not None
    return math.copysign(last, accepted) if math.isclose(abs(last), abs(accepted), rel_tol=SAME) else accepted


def _last_int(value: int, limit: int, held: Held) -> int:
    if held(limit) is not None:
        return limit
    accepted, refused = value, limit
    while abs(refused - accepted) > 1:
        middle = (accepted + refused) // 2
        if held(middle) is None:
            refused = middle
        else:
            accepted = middle
    return accepted
