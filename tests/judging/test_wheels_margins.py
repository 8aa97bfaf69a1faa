"""Margins of `wheels`: those of the flash image are in margins.toml; sweep, model and `plumb tune pid` agree."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import quantise
from plumb.judging.balancer import loops
from plumb.judging.wheels import figures, sweep
from plumb.proof import loop_figures
from plumb.systems.wheels import scenarios as wheels
from plumb.systems.wheels.tuning import WheelsTuning
from plumb.tuning.loop_model import nearest_margins

FULL = max(wheels.BATTERY)


def test_the_flash_image_has_the_margins_that_are_asked() -> None:
    """30 deg, 6 dB, 20 ms of either loop at either end of the battery; tools/gen_margins.py sweeps them."""
    found = loop_figures.identified("wheels")
    assert list(found) == [f"{loop}, battery {end:g}" for loop in sweep.PATTERNS for end in wheels.BATTERY]
    rows = [row for loop, one in found.items() for row in loop_figures.rows(loop, one, "", "", figures.LEAST, "")]
    assert all(row.met for row in rows) and len(rows) == 12
    assert min(one.delay_s for one in found.values()) < 0.03, "the margins of a loop, not of none"


def test_a_sweep_finds_the_loop_of_the_model_and_of_the_flash_image() -> None:
    """Where balance crosses 1 with a full battery, within 1 deg and 2 % on average; the C integers drive the whole
    vehicle."""
    kept = loop_figures.identified("wheels")[f"balance, battery {FULL:g}"]
    hz = np.geomspace(0.8, 1.25, 6) * kept.crossover_hz
    found = sweep.swept_on(NativeBoard(), "balance", FULL, hz)
    model = FULL * loops.loop_gains(0.0, wheels.STEERED.balance, hz)[1]["balance"]
    assert abs(np.mean(np.degrees(np.angle(found / model)))) < 1.0
    assert np.mean(np.abs(found / model)) == pytest.approx(1.0, abs=0.02)
    again = nearest_margins(hz, found)
    assert again.phase_deg == pytest.approx(kept.phase_deg, abs=2.0), "what tools/gen_margins.py has written"
    assert again.crossover_hz == pytest.approx(kept.crossover_hz, rel=0.02)


def test_the_gains_of_the_turn_rate_have_the_margins_when_it_rides() -> None:
    """`plumb tune pid --system wheels`: its margins are those of a sweep, before and with the new gains."""
    pytest.importorskip("scipy", reason="scipy is not installed: the extra tune")
    from plumb.analyses.identification import loop_test, pid_tuning, plant_fit
    from plumb.analyses.identification.pid_design import Wanted

    least, tuning = figures.LEAST, wheels.STEERED
    excited = plant_fit.excitation(tuning.period_s, 8.0)
    with NativeBoard() as board:
        run = loop_test.on_twin(board, quantise(tuning), excited, 4, sweep.SEED)
        tuned = pid_tuning.tune(run, Wanted(least.phase_deg, least.gain_db, least.delay_s))
        supply = sweep.straight_ahead(tuning, sweep.SEED, 20.0).supply
        assert isinstance(tuned.tuned, WheelsTuning)
        for gains, margins in ((tuning, tuned.before), (tuned.tuned, tuned.design.margins)):
            hz = np.array([0.97, 1.03]) * margins.crossover_hz
            swept = nearest_margins(hz, sweep.swept_on(board, "turn", supply, hz, gains))
            assert swept.phase_deg == pytest.approx(margins.phase_deg, abs=2.0)
            assert swept.crossover_hz == pytest.approx(margins.crossover_hz, rel=0.02)
    assert not tuned.refusal() and tuned.design.rejection_db < -0.5, "better than the gains before"
    assert tuned.design.margins.delay_s == pytest.approx(least.delay_s, rel=0.02), "as much as the margins allow"
