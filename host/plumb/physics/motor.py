"""A brushless motor as a plant sees it: rotor angle to Hall state, and a bridge's three phases to the share of the
supply that turns it. Ideal trapezoidal back-EMF; the current's own dynamics (some 0.1 ms) are left to the plant."""

from __future__ import annotations

from collections.abc import Sequence

FORWARD = (5, 1, 3, 2, 6, 4)
"""Hall states of one electrical turn, A is bit 0; each lasts a sixth, the first from angle 0."""


def hall_state(angle_turn: float) -> int:
    """State of the three Hall sensors at an electrical angle."""
    return FORWARD[int(angle_turn % 1.0 * 6.0) % 6]


def back_emf(angle_turn: float) -> tuple[float, float, float]:
    """Of each phase, per unit of speed, -1 to 1: flat for a third of a turn, phase A's positive one from angle 0."""

    def one(phase: int) -> float:
        place = (angle_turn - phase / 3.0) % 1.0 * 6.0  # in sixths
        for begin, value in ((0.0, 1.0), (3.0, -1.0)):
            if begin <= place < begin + 2.0:
                return value
            if begin + 2.0 <= place < begin + 3.0:
                return value * (1.0 - 2.0 * (place - begin - 2.0))
        raise AssertionError("a place in a turn is below six")

    return one(0), one(1), one(2)


def share_of_supply(duty: Sequence[float | None], angle_turn: float) -> float | None:
    """What part of the supply drives the motor forwards, -1 to 1; 0 brakes it; None: fewer than two phases are driven,
    no current flows. duty: each phase's high side, None for both off (f103.tim1.Bridge.duty)."""
    driven = [(share, emf) for share, emf in zip(duty, back_emf(angle_turn), strict=True) if share is not None]
    weight = sum(abs(emf) for _, emf in driven) / 2.0
    if len(driven) < 2 or weight == 0.0:
        return None
    mean = sum(share for share, _ in driven) / len(driven)
    return sum((share - mean) * emf for share, emf in driven) / weight
