"""Margins of `quadrotor`, swept in flight: those of the flash image are in margins.toml, and a short sweep agrees."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.boards.native.board import NativeBoard
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.judging.quadrotor import figures, loops, sweep
from plumb.proof import loop_figures
from plumb.tuning.loop_model import nearest_margins
from support.swept_roll import swept_roll

ABOUT_CROSSOVER_HZ = np.array([3.6, 4.5])
"""Roll crosses at 4.05 Hz."""


def test_the_flash_image_has_the_margins_that_are_asked() -> None:
    """45 deg, 8 dB, 30 ms on every axis; tools/gen_margins.py sweeps them."""
    found = loop_figures.identified("quadrotor")
    assert list(found) == list(loops.PATTERNS)
    rows = [row for axis, one in found.items() for row in loop_figures.rows(axis, one, "", "", figures.LEAST, "")]
    assert all(row.met for row in rows) and len(rows) == 9
    assert min(one.phase_deg for one in found.values()) < 60.0, "the margins of a loop, not of none"


def test_one_flight_of_sines_gives_the_loop_that_a_flight_for_each_sine_gives(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Two ways to break the same loop: within 1 deg and 2 % where roll has its margin."""
    once = sweep.swept_on(NativeBoard(), "roll", ABOUT_CROSSOVER_HZ)
    hz, batch = swept_roll(tmp_path_factory)
    each = np.interp(ABOUT_CROSSOVER_HZ, hz, batch.real) + 1j * np.interp(ABOUT_CROSSOVER_HZ, hz, batch.imag)
    assert np.abs(np.degrees(np.angle(once / each))).max() < 1.0
    assert np.abs(np.abs(once / each) - 1.0).max() < 0.02


@pytest.mark.slow
def test_a_short_sweep_of_the_flash_image_is_that_of_the_core_to_the_bit() -> None:
    """About the crossover of roll, in lockstep on the virtual board: the same pulses, so the same response."""
    pytest.importorskip("unicorn")
    from plumb.boards.virtual import VirtualBoard

    try:
        find_image()
    except UsageError as missing:
        pytest.skip(str(missing))
    with VirtualBoard() as board:
        found = sweep.swept_on(board, "roll", ABOUT_CROSSOVER_HZ)
    assert found.tolist() == sweep.swept_on(NativeBoard(), "roll", ABOUT_CROSSOVER_HZ).tolist()
    margins = nearest_margins(ABOUT_CROSSOVER_HZ, found)
    kept = loop_figures.identified("quadrotor")["roll"]
    assert margins.phase_deg == pytest.approx(kept.phase_deg, abs=1.0), "what tools/gen_margins.py has written"
    assert margins.phase_deg > figures.LEAST.phase_deg and margins.delay_s > figures.LEAST.delay_s
