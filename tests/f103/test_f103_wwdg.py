"""The model of the window watchdog against RM0008 chapter 20, its registers written by the test."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
from support.f103_program import RunningProgram

CR, CFR, SR = 0x40002C00, 0x40002C04, 0x40002C08
WDGA, EWI, EWIF = 0x80, 0x200, 1
WWDGRSTF, IWDGRSTF = 1 << 30, 1 << 29
BOOTS, FLAGS, WARNINGS, COUNT, FEEDS, FAST = 1, 2, 3, 4, 5, 6


@pytest.fixture
def watched(board: Callable[..., RunningProgram]) -> Callable[..., RunningProgram]:
    def start(fast: bool = False, feeds: bool = False) -> RunningProgram:
        b = board("wwdg")
        b.ask(FAST, int(fast))
        b.ask(FEEDS, int(feeds))
        b.machine.advance_us(4000)
        assert b.result(BOOTS) == 1
        return b

    return start


def reset_after_us(b: RunningProgram, limit_us: float = 400_000) -> float:
    begin_us = b.machine.now_us
    assert b.machine.run_until(lambda: b.machine.reset_count == 2, limit_us)
    return b.machine.now_us - begin_us


@pytest.mark.parametrize(
    ("fast", "pclk1_mhz", "exponent", "count"),
    [(False, 8, 0, 0x7F), (False, 8, 1, 0x50), (True, 36, 3, 0x7F), (True, 36, 3, 0x40), (True, 36, 2, 0x63)],
)
def test_it_resets_when_the_count_leaves_0x40(
    watched: Callable[..., RunningProgram], fast: bool, pclk1_mhz: int, exponent: int, count: int
) -> None:
    b = watched(fast)
    step_us = 4096 * 2**exponent / pclk1_mhz
    b.machine.bus.write(CFR, 4, exponent << 7 | 0x7F)
    b.machine.bus.write(CR, 4, WDGA | count)
    steps = reset_after_us(b) / step_us
    assert count - 0x40 <= steps <= count - 0x3F + 0.01  # its divider runs on: the first step is a part of one
    b.machine.advance_us(4000)
    assert b.result(FLAGS) & (WWDGRSTF | IWDGRSTF) == WWDGRSTF
    assert not b.machine.bus.read(CR, 4) & WDGA


def test_feeding_in_time_keeps_it_off(watched: Callable[..., RunningProgram]) -> None:
    b = watched(fast=True)
    b.machine.bus.write(CFR, 4, 3 << 7 | 0x7F)
    for _ in range(10):
        b.machine.bus.write(CR, 4, WDGA | 0x7F)
        b.machine.advance_us(57_000)
    assert b.machine.reset_count == 1
    reset_after_us(b, 2000)


def test_feeding_above_the_window_resets(watched: Callable[..., RunningProgram]) -> None:
    b = watched()
    b.machine.bus.write(CFR, 4, 0x60)
    b.machine.bus.write(CR, 4, WDGA | 0x7F)  # switching on is not feeding
    b.machine.advance_us(0x20 * 512)
    b.machine.bus.write(CR, 4, WDGA | 0x7F)
    b.machine.advance_us(100)
    assert b.machine.reset_count == 1
    b.machine.advance_us(0x1D * 512)
    b.machine.bus.write(CR, 4, WDGA | 0x7F)
    assert reset_after_us(b, 100) < 10


def test_a_count_without_bit_6_resets_at_once(watched: Callable[..., RunningProgram]) -> None:
    b = watched()
    b.machine.bus.write(CR, 4, 0x3F)
    b.machine.advance_us(1000)
    assert b.machine.reset_count == 1  # not enabled
    b.machine.bus.write(CR, 4, WDGA | 0x3F)
    assert reset_after_us(b, 100) < 10


def test_only_a_reset_switches_it_off(watched: Callable[..., RunningProgram]) -> None:
    b = watched()
    b.machine.bus.write(CR, 4, WDGA | 0x7F)
    b.machine.bus.write(CR, 4, 0x7F)
    assert b.machine.bus.read(CR, 4) & WDGA
    reset_after_us(b)


def test_the_count_runs_freely_before_it_is_enabled(watched: Callable[..., RunningProgram]) -> None:
    b = watched()
    b.machine.bus.write(CR, 4, 0x7F)
    b.machine.advance_us(512 * 150)
    assert (0x7F - b.machine.bus.read(CR, 4)) % 128 == 150 % 128
    assert b.machine.bus.read(SR, 4) == EWIF and b.machine.reset_count == 1


def test_the_early_warning_comes_at_0x40_and_may_feed(watched: Callable[..., RunningProgram]) -> None:
    b = watched(feeds=True)
    b.machine.bus.write(CFR, 4, EWI | 0x7F)
    b.machine.bus.write(CR, 4, WDGA | 0x7F)
    b.machine.advance_us(512 * 64 * 3)
    assert b.result(WARNINGS) == 3 and b.result(COUNT) == WDGA | 0x40 and b.machine.reset_count == 1
    b.ask(FEEDS, 0)
    b.machine.advance_us(512 * 65)
    assert b.machine.reset_count == 2


def test_it_counts_in_sleep_and_through_an_erase_and_with_a_new_clock(watched: Callable[..., RunningProgram]) -> None:
    """The same 64 steps, half of them at 8 MHz, half at 36 MHz."""
    b = watched()
    b.machine.bus.write(CFR, 4, 3 << 7 | 0x7F)
    b.machine.bus.write(CR, 4, WDGA | 0x7F)
    b.machine.cpu.sleeping = True
    slow_us, fast_us = 4096 * 8 / 8, 4096 * 8 / 32
    b.machine.advance_us(32 * slow_us)
    b.machine.flash.acr = 0x32
    rcc = b.machine.rcc
    rcc.write_cfgr(14 << 18 | 4 << 8)
    rcc.write_cr(rcc.cr | 1 << 24)
    b.machine.advance_us(300)
    rcc.write_cfgr(rcc.cfgr | 2)
    # 32 steps are left, less the 300 us and the phase of the divider when the clock changed.
    assert 30 * fast_us < reset_after_us(b) <= 33 * fast_us


def test_without_its_clock_it_stands_still_and_warns(watched: Callable[..., RunningProgram]) -> None:
    b = watched()
    b.machine.bus.write(CR, 4, WDGA | 0x7F)
    b.machine.rcc.write_apb1enr(0)
    b.machine.advance_us(1_000_000)
    assert b.machine.reset_count == 1 and any("window watchdog" in text for text in b.machine.warnings)
