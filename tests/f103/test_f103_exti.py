"""Edges of pins reach their handlers: the port of a line, both edges, masks, and a line by software."""

from __future__ import annotations

import pytest

from support.f103_program import NewBoard, RunningProgram

PRESSED, STEPS_A, STEPS_B, SOFTWARE = 1, 1, 0x100, 1


@pytest.fixture
def buttons(board: NewBoard) -> RunningProgram:
    b = board("exti")
    b.machine.advance_us(200)
    assert b.result(0) == 1
    return b


def turn(b: RunningProgram, pin: str, *levels: bool | None) -> None:
    for level in levels:
        b.machine.drive(pin, level)
        b.machine.advance_us(50)


def test_a_button_interrupts_when_it_is_pressed_alone(buttons: RunningProgram) -> None:
    turn(buttons, "PA0", False, None, False, None)
    assert (buttons.result(1), buttons.result(2)) == (2 * PRESSED, 0)


def test_both_edges_of_the_port_that_is_selected(buttons: RunningProgram) -> None:
    turn(buttons, "PB5", True, False, True)
    turn(buttons, "PB6", True, False)
    turn(buttons, "PA5", True, False)
    assert buttons.result(2) == 3 * STEPS_A + 2 * STEPS_B


def test_a_line_is_raised_by_software_and_cleared_with_its_pending_bit(buttons: RunningProgram) -> None:
    buttons.ask(8, 1)
    buttons.machine.advance_us(50)
    assert (buttons.result(1), buttons.result(3)) == (SOFTWARE, 0)


def test_a_masked_edge_stays_pending_until_the_mask_is_opened(buttons: RunningProgram) -> None:
    buttons.ask(8, 2)
    buttons.machine.advance_us(50)
    turn(buttons, "PA0", False)
    assert (buttons.result(1), buttons.result(4)) == (0, 1)
