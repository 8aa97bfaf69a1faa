"""The simulated peripherals: UART with DMA, ADC by timer and DMA, PWM, pins; and their failures on request."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from plumb.f103 import Machine
from support.f103_program import NewBoard, RunningProgram

BYTE_US = 10 * 78 / 72  # at the divider that uart.c sets


def echo(machine: Machine, data: bytes) -> bytes:
    machine.uart.write(data)
    out = b""
    while len(out) < len(data):
        part = machine.uart.read(len(data) - len(out))
        assert part, f"only {out!r} came back"
        out += part
    return out


def started(board: NewBoard, **options: Any) -> RunningProgram:
    b = board("uart", **options)
    b.machine.advance_us(5000)
    assert b.result(0) == 1
    assert b.machine.warnings == []
    return b


def test_dma_echo_carries_every_byte_in_order_and_in_time(board: NewBoard) -> None:
    b = started(board)
    machine = b.machine
    begin = machine.now_us
    assert echo(machine, b"t1008001122334455667\r") == b"t1008001122334455667\r"
    # 21 bytes in, one byte of silence, 21 bytes out; the look-ahead ends with the last byte.
    assert 42 * BYTE_US < machine.now_us - begin < 46 * BYTE_US
    data = bytes(range(256)) * 4
    assert echo(machine, data) == data
    assert b.result(1) & 0x2F == 0, "no error flag, no byte left in the register"
    assert b.result(1) & 0x10, "IDLE was seen"
    assert b.result(2) & 7 << 16 == 7 << 16, "half and full were seen"


def test_transmission_by_dma_ends_when_the_last_byte_is_handed_over(board: NewBoard) -> None:
    b = started(board)
    b.machine.uart.write(b"0123456789")
    assert b.machine.run_until(lambda: b.result(3) == 1, 1e4)
    left_us = (b.machine.usart.tx_free - b.machine.now) / 40320
    assert BYTE_US < left_us <= 2 * BYTE_US, "one byte on the line and one in the data register"


def test_a_line_that_stays_high_interrupts_again(board: NewBoard) -> None:
    b = board("transmit")
    b.machine.uart.baudrate = 115200
    b.machine.uart.timeout = 0.01
    b.machine.advance_us(10)
    assert b.machine.uart.read(64) == b"one interrupt per byte"
    b.machine.advance_us(1000)
    assert b.result(0) == len("one interrupt per byte") + 1


def test_two_runs_give_the_same_bytes_and_the_same_memory(board: NewBoard) -> None:
    def run() -> tuple[list[bytes], bytes, int, int]:
        b = started(board)
        out = [echo(b.machine, bytes((i * 7 + k) & 0xFF for k in range(1 + i % 40))) for i in range(30)]
        return out, bytes(b.machine.cpu.ram), b.machine.now, b.machine.cpu.instructions

    assert run() == run()


def test_an_image_of_any_form_runs_the_same(board: NewBoard, build: Callable[[str], Path]) -> None:
    outcomes = set()
    for suffix in (".bin", ".elf", ".hex"):
        machine = Machine(build("uart").with_suffix(suffix))
        machine.advance_us(5000)
        outcomes.add((echo(machine, b"same"), bytes(machine.cpu.ram), machine.now))
    assert len(outcomes) == 1


def test_reading_an_idle_line_ends_after_the_timeout(board: NewBoard) -> None:
    machine = started(board).machine
    begin = machine.now_us
    machine.uart.timeout = 0.003
    assert machine.uart.read(1) == b""
    assert machine.now_us - begin == pytest.approx(3000, abs=1)
    assert machine.uart.clock_s() == pytest.approx(machine.now_us * 1e-6)


def test_a_short_reply_is_not_waited_for_beyond_its_end(board: NewBoard) -> None:
    machine = started(board).machine
    machine.uart.write(b"abc")
    begin = machine.now_us
    assert machine.uart.read(100) == b"abc"
    # Three bytes in, one byte of silence, three bytes out.
    assert machine.now_us - begin < 8 * BYTE_US


def test_framing_errors_noise_and_overruns_on_request(board: NewBoard) -> None:
    b = started(board)
    uart = b.machine.uart
    uart.write_with_framing_error(b"F")
    assert uart.read(1) == b"F"
    assert b.result(1) & 2
    uart.write_with_noise(b"N")
    assert uart.read(1) == b"N"
    assert b.result(1) & 4
    uart.write_overrun(b"lost")
    uart.write(b"kept")
    assert uart.read(4) == b"kept"
    assert b.result(1) & 8


def test_a_wrong_baud_rate_gives_garbage_and_framing_errors(board: NewBoard) -> None:
    b = started(board)
    b.machine.uart.baudrate = 115200
    b.machine.uart.write(b"U")
    received = b.machine.uart.read(1)
    assert received not in (b"", b"U")
    assert b.result(1) & 2


def test_a_slow_reader_overruns_without_dma(board: NewBoard) -> None:
    b = board("polled")
    uart = b.machine.uart
    uart.baudrate = 115200
    b.machine.advance_us(1000)
    uart.timeout = 0.01
    uart.write(b"ab")
    assert uart.read(2) + uart.read(2) == b"ab"
    assert not b.result(0) & 8
    uart.write(b"!cdefghij")
    out = b"".join(uart.read(9) for _ in range(3))
    assert out[:1] == b"!"
    assert len(out) < 9
    assert b.result(0) & 8


def test_adc_scans_follow_the_timer(board: NewBoard) -> None:
    b = board("adc")
    machine = b.machine
    times = []

    def ramp(t_s: float) -> float:
        times.append(t_s)
        return 3.3 * (t_s * 10 % 1.0)

    machine.adc["PA0"] = 1.0
    machine.adc["PA1"] = 3.2999
    machine.adc["PA2"] = ramp
    machine.advance_us(50_000)
    scans = b.result(0)
    machine.advance_us(100_000)
    assert b.result(0) - scans == 100
    assert b.result(1) == round(1.0 / 3.3 * 4096)
    assert b.result(2) == 4095
    assert abs(b.result(3) - 4096 * (times[-1] * 10 % 1.0)) <= 1
    gaps = [later - sooner for sooner, later in pairwise(times)]
    assert max(gaps) - min(gaps) < 1e-9
    assert gaps[0] == pytest.approx(1e-3)
    # Three conversions of 252 cycles at 12 MHz are 63 us.
    assert 63 <= b.result(4) <= 65
    assert b.result(5) > 0, "calibration took time"
    assert machine.warnings == []


@pytest.mark.parametrize(("volts", "count"), [(-5.0, 0), (0.0, 0), (3.3 / 8192 + 1e-6, 1), (1.65, 2048), (12.0, 4095)])
def test_volts_become_counts(board: NewBoard, volts: float, count: int) -> None:
    b = board("adc")
    b.machine.adc["PA0"] = volts
    b.machine.advance_us(10_000)
    assert b.result(1) == count


def test_a_silent_adc_says_nothing(board: NewBoard) -> None:
    b = board("adc")
    b.machine.advance_us(20_000)
    scans = b.result(0)
    assert scans > 0
    b.machine.adc1.silent = True
    b.machine.advance_us(20_000)
    assert b.result(0) <= scans + 1


def test_pwm_changes_only_between_two_pulses(board: NewBoard) -> None:
    b = board("pwm")
    machine = b.machine
    machine.advance_us(6_000)
    assert machine.pwm("PB6") == (1000.0, 2500.0, True)
    assert machine.pwm("PB7") == (1500.0, 2500.0, True)
    assert not machine.pwm("PB8").enabled
    start = machine.tim4.zero_at
    machine.run_to(start + 2500 * 40320 + 100 * 40320)  # 100 us into a period
    b.ask(0, 3500)
    machine.advance_us(2000)
    assert machine.pwm("PB6").pulse_us == 1000.0
    machine.advance_us(600)
    assert machine.pwm("PB6").pulse_us == 1750.0
    machine.advance_us(1_234.5)
    machine.pwm("PB6")
    assert (machine.tim4.zero_at - start) % (2500 * 40320) == 0, "periods do not drift with the asking"
    machine.power_cut()
    assert not machine.pwm("PB6").enabled


def test_update_disable_keeps_every_preloaded_register_back(board: NewBoard) -> None:
    """RM0008 15.4.1: with UDIS set there is no update event, neither at the end of a frame nor by UG, and no flag."""
    machine = board("pwm").machine
    machine.advance_us(20_000)
    tim4, cr1, sr, egr, ccr2 = machine.tim4, 0x40000800, 0x40000810, 0x40000814, 0x40000838
    before = machine.pwm("PB7")
    machine.bus.write(cr1, 4, 0x83)
    machine.bus.write(ccr2, 4, 3600)
    machine.bus.write(sr, 4, 0)
    machine.advance_us(10_000)
    machine.bus.write(egr, 4, 1)
    assert machine.pwm("PB7") == before and not machine.bus.read(sr, 4)
    assert tim4.count(machine.now) == 0  # UG restarts the count all the same
    machine.bus.write(cr1, 4, 0x81)
    machine.advance_us(2_400)
    assert machine.pwm("PB7") == before
    machine.advance_us(200)
    assert machine.pwm("PB7").pulse_us == 1800.0 and machine.bus.read(sr, 4) == 1


RCC, TIM1, TIM4, GPIOB = 0x40021000, 0x40012C00, 0x40000800, 0x40010C00


def write(machine: Machine, base: int, registers: dict[int, int]) -> None:
    for offset, value in registers.items():
        machine.bus.write(base + offset, 4, value)


@pytest.mark.parametrize("cut", ["", "counter", "mode", "inputs", "clock"])
def test_an_encoder_moves_the_count_and_both_pins(board: NewBoard, cut: str) -> None:
    """RM0008 15.3.12: up and down, past both ends, and only when all that it needs is set up."""
    machine = board("pwm").machine
    write(machine, RCC, {0x18: 0x8, 0x1C: 4})
    write(machine, TIM4, {0x18: 0xF0F0 if cut == "inputs" else 0xF1F1, 0x08: 0 if cut == "mode" else 3})
    if cut not in ("counter", "mode"):  # without the mode it would count the clock
        write(machine, TIM4, {0x00: 1})
    if cut == "clock":
        write(machine, RCC, {0x1C: 0})
    seen = []
    for turned in (1, 1, 1, 1, -6, 65_538):
        machine.turn_encoder("TIM4", turned)
        machine.advance_us(1)
        seen.append((machine.tim4.read_cnt(), machine.pin("PB6"), machine.pin("PB7")))
    assert [levels for _, *levels in seen] == [[1, 0], [1, 1], [0, 1], [0, 0], [1, 1], [0, 0]]
    assert [count for count, *_ in seen] == ([0] * 6 if cut else [1, 2, 3, 4, 65_534, 0])


@pytest.mark.parametrize("cut", ["", "main output", "complement", "both", "counter", "mode", "pin"])
def test_a_complementary_output_alone_has_the_share_of_its_reference(board: NewBoard, cut: str) -> None:
    """RM0008 table 83, CCxE = 0 and CCxNE = 1: only then, and only where the pin is the timer's."""
    machine = board("pwm").machine
    write(machine, RCC, {0x18: 0x808})
    write(machine, GPIOB, {0x04: 0x43444444 if cut == "pin" else 0x4A444444})
    write(machine, TIM1, {0x2C: 900, 0x38: 225, 0x18: 0x4800 if cut == "mode" else 0x6800, 0x14: 1})
    write(machine, TIM1, {0x20: {"complement": 0, "both": 0x50}.get(cut, 0x40)})
    write(machine, TIM1, {0x00: 0xA0 if cut == "counter" else 0xA1, 0x44: 0 if cut == "main output" else 1 << 15})
    assert machine.duty("PB14") == (None if cut else 0.25) and machine.duty("PB15") is None
    write(machine, TIM1, {0x38: 5000})
    machine.advance_us(400)
    assert machine.duty("PB14") == (None if cut else 1.0), "preloaded until the end of a half period"
    machine.power_cut()
    assert machine.duty("PB14") is None


def test_pins_are_checked_by_name(board: NewBoard) -> None:
    from plumb.errors import UsageError

    machine = board("pwm").machine
    for wrong in (lambda: machine.pwm("PA4"), lambda: machine.pin("PZ1"), lambda: machine.drive("PA16", True)):
        with pytest.raises(UsageError, match=r"PA|PB"):
            wrong()
    with pytest.raises(UsageError, match="ADC input"):
        machine.adc["PB9"] = 1.0


RXNE, ORE, FE = 1 << 5, 1 << 3, 1 << 1


def test_usart3_receives_by_interrupt_and_an_overrun_loses_the_later_byte(board: NewBoard) -> None:
    b = board("receive")
    usart = b.machine.usart3

    def taken(count: int) -> list[tuple[int, int]]:
        """Errors and byte of the newest interrupts."""
        last = b.result(0)
        both = [b.result(8 + place) for place in range(last - count, last)]
        return [(one >> 8 & (RXNE | ORE | FE), one & 0xFF) for one in both]

    b.machine.advance_us(1000)
    assert b.result(2) == 1 and usart.baud == pytest.approx(8e6 / 19)
    begin = b.machine.now_us
    usart.receive(b"\x11\x22\x33")
    assert b.machine.run_until(lambda: b.result(0) == 3, 1000)
    assert b.machine.now_us - begin == pytest.approx(30e6 / 420e3, abs=8)
    assert taken(3) == [(RXNE, 0x11), (RXNE, 0x22), (RXNE, 0x33)]
    b.ask(1, 1)
    b.machine.advance_us(10)
    usart.receive(b"\x44\x55\x66")
    b.machine.advance_us(100)
    assert b.result(0) == 3
    b.ask(1, 0)
    b.machine.advance_us(10)
    assert taken(1) == [(RXNE | ORE, 0x44)] and b.result(0) == 4, "one byte is in DR; the others are lost"
    usart.receive(b"\x77", FE)
    usart.host_baud = 460800
    usart.receive(b"\x88")
    b.machine.advance_us(100)
    assert [flags for flags, _ in taken(2)] == [RXNE | FE, RXNE | FE], "a wrong stop bit; another rate"
    usart.host_baud = 420000
    usart.receive(b"\x99")
    b.machine.advance_us(100)
    assert taken(1) == [(RXNE, 0x99)] and b.machine.warnings == []


@pytest.mark.parametrize("why", ["output", "remapped", "no clock"])
def test_usart3_receives_nothing_on_a_pin_that_is_not_its_own(board: NewBoard, why: str) -> None:
    b = board("receive")
    machine = b.machine
    machine.advance_us(1000)
    if why == "output":
        machine.port("PB11").write_crh(0x44443444)
    elif why == "remapped":
        machine.rcc.write_apb2enr(machine.rcc.apb2enr | 1)
        machine.afio.write_mapr(1 << 4)
    else:
        machine.rcc.write_apb1enr(0)
        machine.usart3.reset()
    machine.usart3.receive(b"\x11")
    machine.advance_us(100)
    assert b.result(0) == 0
