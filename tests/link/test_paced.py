"""A run in real time whose parameters change at a chosen step: what the board does not confirm is unverified, never
compared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb.boards import open_board
from plumb.boards.virtual import VirtualBoard
from plumb.contract import run_fixed
from plumb.contract.parameters import Change
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.link.paced import PacedAnswer, PacedRun
from plumb.spec.protocol import Frame, protocol
from plumb.systems import shipped_tunings
from plumb.tuning import quantities

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)

STEPS, FIRST, SECOND, STEERED = 40, 20, 21, 33
QUAD = {**shipped_tunings.table_of("quad", None), "period_us": 2500}
BEGIN = quantities.control_of(QUAD)
CHANGES = tuple(
    Change(step, quantities.control_of({**QUAD, "pid.kp_q22": gain})) for step, gain in ((FIRST, 4711), (SECOND, 77))
)
ROWS = np.arange(STEPS)[:, None]
RAW = np.hstack([1700 + 9 * ROWS, 2100 - 5 * ROWS, 3000 + ROWS, 0 * ROWS, 0 * ROWS, 0 * ROWS]).astype(np.int16)
SETPOINT = np.where(np.arange(STEPS) < STEERED, 1 << 20, 1 << 28).astype(np.int32)


@pytest.fixture(scope="module", params=["serial", "can"])
def board(request: pytest.FixtureRequest) -> Iterator[VirtualBoard]:
    with open_board("virtual", link=request.param) as opened:
        assert isinstance(opened, VirtualBoard)
        yield opened


def prepared(board: VirtualBoard) -> PacedRun:
    board.session.upload(BEGIN.words(), **BEGIN.link_words(), period_us=QUAD["period_us"])
    return PacedRun(board.session, "quad", CHANGES, RAW, SETPOINT)


def as_the_model(answer: PacedAnswer) -> bool:
    expected = run_fixed.run_changed(BEGIN, CHANGES, RAW, SETPOINT).digests()
    return bool(np.array_equal(expected[: len(answer.digests)], answer.digests))


def test_two_changes_in_a_row_meet_their_steps(board: VirtualBoard) -> None:
    answer = prepared(board).run()
    assert (len(answer.digests), answer.why) == (STEPS, "") and as_the_model(answer)
    stale = run_fixed.run_changed(BEGIN, CHANGES[:1], RAW, SETPOINT).digests()
    assert not np.array_equal(stale, answer.digests), "the second change shows"


def test_a_commit_that_comes_a_step_late_is_unverified_from_its_step_on(board: VirtualBoard) -> None:
    paced = prepared(board)
    paced._left[1] = replace(paced._left[1], step=SECOND + 1)
    answer = paced.run()
    assert len(answer.digests) == SECOND and as_the_model(answer)
    assert answer.why == f"the other parameters of step {SECOND} were not in use from this very step on"


@pytest.mark.parametrize(
    ("name", "unverified", "why"),
    [
        ("PARAM_COMMIT", FIRST, f"the board did not say that step {FIRST} used the other parameters"),
        ("SETPOINT", 0, "the setpoint of step 0 did not reach the board in time"),
        ("SAMPLE_A", 0, "the sample of step 0 did not reach the board in time"),
    ],
)
def test_frames_that_the_board_never_had_are_found_out(
    board: VirtualBoard, monkeypatch: pytest.MonkeyPatch, name: str, unverified: int, why: str
) -> None:
    paced, inner = prepared(board), PacedRun._for_step

    def without(self: PacedRun, step: int) -> list[Frame]:
        return [frame for frame in inner(self, step) if frame[0] != protocol()[name].identifier]

    monkeypatch.setattr(PacedRun, "_for_step", without)
    answer = paced.run()
    assert (len(answer.digests), answer.why) == (unverified, why)
