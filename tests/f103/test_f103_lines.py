"""The host's ends of USART2 and USART3, beside that of USART1."""

from __future__ import annotations

import pytest

from support.f103_program import NewBoard


@pytest.mark.parametrize("remapped", [False, True])
def test_usart2_answers_on_both_pairs_of_pins(board: NewBoard, remapped: bool) -> None:
    b = board("lines")
    b.ask(0, int(remapped))
    line = b.machine.uart2
    line.baudrate = 115_200
    b.machine.advance_us(100)
    line.write(b"abc")
    b.machine.advance_us(500)
    assert line.read(3) == b"bcd"
    assert b.machine.uart.in_waiting == b.machine.uart3.in_waiting == 0
    assert not b.machine.warnings


def test_at_another_rate_it_understands_nothing(board: NewBoard) -> None:
    b = board("lines")
    b.ask(0, 0)
    b.machine.uart2.baudrate = 9_600
    b.machine.advance_us(100)
    b.machine.uart2.write(b"a")
    assert b.machine.uart2.read(1) != b"b"
