"""Gains that change during a run that is not armed: bit for bit as in the model."""

from __future__ import annotations

import pytest

from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.link import parameter_table
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.proof.shadow import Shadow
from plumb.spec.parameter_file import by_name
from plumb.systems import shipped_tunings
from plumb.tuning import quantities
from support.native_board import NewBoard
from support.sessions import STEER

TABLE = {**shipped_tunings.table_of("quad", None), "period_us": 2500}
STEPS = 40


def begun(session: Session) -> Capture:
    parameter_table.commit(session, TABLE)
    capture = Capture(session)
    session.begin("REALTIME_LIVE", frames=["RAW_A", "RAW_B"])
    session.listener = capture.feed
    capture.set_setpoint(STEER)
    return capture


def digests(capture: Capture, before: ControlParams, after: ControlParams, at: int | None) -> list[int]:
    """Of the model on the captured counts, with other parameters from step `at` on."""
    model, found = run_fixed.Controller(before), []
    setpoints = capture.setpoints.of_steps(capture.steps)
    for step in range(capture.steps - 2):
        if step == at:
            model.retune(after)
        model.step(capture.raw[step], setpoints[step])
        found.append(model.digest())
    return found


def test_every_step_equals_the_model_before_and_after_a_change(new_board: NewBoard) -> None:
    board = new_board()
    with Session(PlumbBus(board)) as session:
        session.connect()
        capture = begun(session)
        capture.collect(STEPS)
        table = by_name(parameter_table.read_table(session))
        wanted = {"pid.kp_per_deg": 0.02, "pid.ki_per_deg_s": 0.5, "pid.kd_per_dps": 0.001}
        after = quantities.changed(table, wanted)
        parameter_table.commit(session, after)
        at = capture.parameters_step
        capture.collect(capture.steps + STEPS)
        assert at is not None and STEPS <= at < capture.steps - STEPS // 2
        assert capture.unverified_from(at) is None and capture.unverified_from(at + 1) == at
        old, new = quantities.control_of(table), quantities.control_of(after)
        board_digests = [capture.digest[step] for step in range(capture.steps - 2)]
        assert digests(capture, old, new, at) == board_digests
        assert digests(capture, old, new, None)[at] != board_digests[at], "the change shows at once"
        assert quantities.values_of(by_name(parameter_table.read_table(session)))["pid.kp_per_deg"] == pytest.approx(
            0.02
        )


def test_a_comparison_goes_on_across_a_change(new_board: NewBoard) -> None:
    board = new_board()
    with Session(PlumbBus(board)) as session:
        session.connect()
        capture = begun(session)
        shadow = Shadow(quantities.control_of(TABLE))
        capture.collect(STEPS)
        parameter_table.commit(session, quantities.changed(TABLE, {"pid.kp_per_deg": 0.02}))
        at = capture.parameters_step
        capture.collect(capture.steps + STEPS)
        shadow.follow(capture, 0)
        assert (shadow.verdict, shadow.unverified_from, shadow.divergence) == ("pass", None, None)
        assert at is not None and shadow.steps == capture.steps - 1 > at + STEPS // 2
        assert [change.step for change in shadow.changes] == [at]
