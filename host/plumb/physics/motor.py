"""Brushless motor: Hall state of a rotor angle, and the part of the supply voltage that drives the motor for the duties
of a three-phase bridge. Ideal trapezoidal back-EMF; the current's dynamics (some 0.1 ms) are not modelled here."""

from __future__ import annotations

from collections.abc import Sequence

FORWARD = (5, 1, 3, 2, 6, 4)
"""Hall states of one electrical turn, A is bit 0. Each lasts a sixth of a turn; the first begins at angle 0."""


def hall_state(angle_turn: float) -> int:
    """State of the three Hall sensors, 1 to 6, at an electrical angle in turns."""
    return FORWARD[int(angle_turn % 1.0 * 6.0) % 6]


def back_emf(angle_turn: float) -> tuple[float, float, float]:
    """Back-EMF of each phase per unit of speed, -1 to 1: flat for a third of a turn, of phase A positive from angle
    0."""

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
    """Part of the supply voltage that drives the motor forward, -1 to 1; 0 brakes it. None when fewer than two phases
    are driven, so that no current flows. duty: of each phase's high side, 0 to 1; None: both switches off."""
    driven = [(share, emf) for share, emf in zip(duty, back_emf(angle_turn), strict=True) if share is not None]
    weight = sum(abs(emf) for _, emf in driven) / 2.0
    if len(driven) < 2 or weight == 0.0:
        return None
    mean = sum(share for share, _ in driven) / len(driven)
    return sum((share - mean) * emf for share, emf in driven) / weight
