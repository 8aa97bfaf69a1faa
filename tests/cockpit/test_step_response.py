"""Figures of step responses whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb.cockpit.step_response import figures

TIME_S = np.arange(0.0, 5.0, 0.002)


def test_first_order() -> None:
    tau_s = 0.3
    value = 10.0 - 5.0 * (1.0 - np.exp(-TIME_S / tau_s))
    found = figures((TIME_S + 7.0).tolist(), value.tolist(), 7.0, 10.0, -5.0)
    assert found is not None and found.rise_s is not None and found.settling_s is not None
    # A sample every 2 ms: two for either crossing, and as many again where the course is flat.
    assert found.rise_s == pytest.approx(tau_s * math.log(9.0), abs=0.005)
    assert found.settling_s == pytest.approx(tau_s * math.log(20.0), abs=0.01)
    # After 5 s, 17 times tau, 6e-8 is left of the step; the end is a mean of the last samples.
    assert found.overshoot_percent == pytest.approx(0.0, abs=0.01)
    assert found.off == pytest.approx(0.0, abs=1e-4)


def test_second_order_overshoots() -> None:
    damping, rate = 0.4, 8.0
    damped = rate * math.sqrt(1.0 - damping**2)
    sway = np.cos(damped * TIME_S) + damping / math.sqrt(1 - damping**2) * np.sin(damped * TIME_S)
    value = 1.0 - np.exp(-damping * rate * TIME_S) * sway
    found = figures(TIME_S.tolist(), value.tolist(), 0.0, 0.0, 1.0)
    assert found is not None
    # The peak lies between two samples, and the sway has died down to e^-16.
    assert found.overshoot_percent == pytest.approx(
        100.0 * math.exp(-math.pi * damping / math.sqrt(1 - damping**2)), abs=0.1
    )


def test_a_signal_that_never_moves_has_neither_rise_nor_good_end() -> None:
    found = figures(TIME_S.tolist(), np.zeros(len(TIME_S)).tolist(), 0.0, 0.0, 2.0)
    assert found is not None
    assert found.rise_s is found.settling_s is None and found.off == pytest.approx(-2.0)


def test_a_signal_that_swings_on_does_not_settle() -> None:
    found = figures(TIME_S.tolist(), (1.0 + 0.3 * np.sin(20.0 * TIME_S)).tolist(), 0.0, 0.0, 1.0)
    assert found is not None and found.settling_s is None


def test_too_few_samples_have_no_figures() -> None:
    assert figures([0.0] * 9, [1.0] * 9, 0.0, 0.0, 1.0) is None
