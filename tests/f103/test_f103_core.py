"""The simulated core: exceptions, masks, sleep, faults and clocks behave as Armv7-M and RM0008 say."""

from __future__ import annotations

import os
import re
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from plumb.extras import install_hint
from plumb.process_signals import Terminated, raise_at_once, raised
from support.f103_program import NewBoard, RunningProgram

FAULT_HARD, FAULT_BUS, FAULT_USAGE = 3, 5, 6
RESET_POWER, RESET_SOFTWARE, RESET_WATCHDOG, RESET_PIN = 1 << 27, 1 << 28, 1 << 29, 1 << 26


def letters(board: RunningProgram) -> str:
    return bytes(board.machine.cpu.ram[:40]).split(b"\0")[0].decode()


def test_exceptions_preempt_chain_and_obey_the_masks(board: NewBoard) -> None:
    b = board("nesting")
    b.machine.advance_us(2000)
    first = "a(h)bct1"
    masked = "2a(h)bctp3"
    assert letters(b) == first + masked + "s4" + "5(h)6t7"
    assert b.result(60) == 1
    # Twice an interrupt, one inside it and one chained to it (with PendSV behind, the second time), then three alone.
    entry, leave, chain = 12, 10, 6
    overhead = 2 * (entry + entry + leave + chain + leave) + chain + 3 * (entry + leave)
    cpu = b.machine.cpu
    assert (b.machine.now - cpu.instructions * cpu.instruction_ticks) == overhead * b.machine.rcc.hclk_ticks


def test_systick_keeps_time_and_no_wakeup_is_lost(board: NewBoard) -> None:
    b = board("systick")
    b.machine.advance_us(10_000)
    ticks, cycles, zero_at = b.result(0), b.result(5), b.machine.systick.zero_at
    b.machine.advance_us(100_000)
    assert b.result(0) - ticks == 100
    assert b.machine.systick.zero_at - zero_at == 100 * 1000 * 40320
    assert b.result(2) == b.result(0)
    assert b.result(1) >= 100
    assert b.result(3) == 0, "the handler ran before the mask was opened"
    assert 71_900 < b.result(4) < 72_000, "VAL read just after it wrapped"
    assert b.result(5) - cycles < 0.02 * 72 * 100_000, "CYCCNT stands still during WFI"


def test_a_dead_crystal_ends_in_the_fallback(board: NewBoard) -> None:
    good, dead = board("clock"), board("clock", crystal=False)
    for b in (good, dead):
        b.machine.advance_us(50_000)
        assert b.result(8) == 1
        assert b.result(0) & 0xFF == 0x83
        assert b.result(1) & 0xFC000000 == RESET_POWER | RESET_PIN
        assert b.result(4) == 0, "the id register reads 0 without a debugger"
        # 1000 turns of about four instructions at 9/4 cycles each
        assert 8250 < b.result(7) < 12_000
    assert good.result(6) & 0xF == 0xA
    assert good.result(5) < 20000
    assert dead.result(5) == 20000
    assert good.machine.rcc.hclk_ticks * 72 == dead.machine.rcc.hclk_ticks * 64


@pytest.mark.parametrize(
    ("part", "flash_kib"), [("stm32f103c8", 64), ("stm32f103rct6", 256), ("stm32f103ret6", 512), ("stm32f103zet6", 512)]
)
def test_parts_report_their_flash_size_and_a_seeded_id(board: NewBoard, part: str, flash_kib: int) -> None:
    ids = []
    for seed in (1, 1, 2):
        b = board("clock", part=part, seed=seed)
        b.machine.advance_us(20_000)
        assert b.result(2) == flash_kib
        ids.append(b.result(3))
    assert ids[0] == ids[1] != ids[2]


@pytest.mark.parametrize(
    ("cause", "enabled", "handler", "cfsr", "forced"),
    [
        (1, 0, FAULT_HARD, 0x8200, 1 << 30),
        (1, 1, FAULT_BUS, 0x8200, 0),
        (2, 1, FAULT_BUS, 0x8200, 0),
        (3, 1, FAULT_USAGE, 0x10000, 0),
        (3, 0, FAULT_HARD, 0x10000, 1 << 30),
    ],
)
def test_faults_reach_their_handler_and_return(
    board: NewBoard, cause: int, enabled: int, handler: int, cfsr: int, forced: int
) -> None:
    b = board("fault", faults="run")
    b.ask(0, cause)
    b.ask(7, enabled)
    b.machine.advance_us(1000)
    assert (b.result(2), b.result(4), b.result(5)) == (handler, cfsr, forced)
    if cause < 3:
        assert b.result(6) == (0x60000000 if cause == 1 else 0x08000000)
    assert b.result(1) == 1, "the program went on behind the fault"
    assert (b.machine.scb.cfsr, b.machine.scb.hfsr) == (0, 0), "cleared by writing ones"


def test_a_register_that_is_not_modelled_stops_with_its_address(board: NewBoard) -> None:
    from plumb.f103 import SimulationError

    b = board("fault", faults="run")
    b.ask(0, 4)
    with pytest.raises(SimulationError, match="0x40005800"):
        b.machine.advance_us(1000)


def test_a_peripheral_without_clock_reads_zero_and_is_reported(board: NewBoard) -> None:
    b = board("fault", faults="run")
    b.ask(0, 5)
    b.machine.advance_us(1000)
    assert b.result(1) == 1
    assert b.result(8) == 0
    assert b.machine.warnings == [
        "ADC1 is written at 0x40012408 while its clock is off in RCC",
        "ADC1 is read at 0x40012408 while its clock is off in RCC",
    ]


def test_read_modify_write_of_the_remap_register_loses_the_debug_port(board: NewBoard) -> None:
    b = board("fault", faults="run")
    b.ask(0, 6)
    assert b.machine.afio.debug_port
    b.machine.advance_us(1000)
    assert b.machine.afio.mapr == 4
    assert not b.machine.afio.debug_port


def test_too_few_wait_states_stop_the_simulation(board: NewBoard) -> None:
    from plumb.f103 import SimulationError

    b = board("fault", faults="run")
    b.ask(0, 7)
    with pytest.raises(SimulationError, match="72 MHz with 0 flash wait states"):
        b.machine.advance_us(10_000)


def test_a_handler_that_needs_the_stack_that_failed_locks_the_core_up(board: NewBoard) -> None:
    b = board("fault", faults="run")
    b.ask(0, 8)
    b.machine.advance_us(1000)
    assert "fault inside the fault handler" in b.machine.cpu.locked_up
    assert b.machine.scb.cfsr & 1 << 12, "STKERR"
    b.ask(0, 0)
    b.machine.reset()
    b.machine.advance_us(1000)
    assert b.machine.cpu.locked_up == ""
    assert b.result(1) == 1


def test_the_watchdog_resets_when_it_is_not_fed_and_flags_say_so(board: NewBoard) -> None:
    b = board("watchdog")
    machine = b.machine
    assert machine.run_until(lambda: machine.reset_count == 2, 1e6)
    # 50 ms after the last of ten meals 10 ms apart
    assert 145_000 < machine.now_us < 155_000
    assert b.result(10) == 10
    assert machine.run_until(lambda: machine.reset_count == 4, 1e6)
    machine.advance_us(100)
    flags = [b.result(2 + i) & 0xFC000000 for i in range(4)]
    expected = [RESET_POWER, RESET_WATCHDOG, RESET_WATCHDOG, RESET_SOFTWARE]
    assert flags == [flag | RESET_PIN for flag in expected]


def test_the_watchdog_runs_on_its_own_oscillator(board: NewBoard) -> None:
    b = board("watchdog")
    b.machine.iwdg.lsi_hz = 60_000
    assert b.machine.run_until(lambda: b.machine.reset_count == 2, 1e6)
    # Ten meals 10 ms apart, then 50 ms of an oscillator that runs at 60 instead of 40 kHz, 33 ms; half a meal more or
    # less.
    assert 128_000 < b.machine.now_us < 138_000


def test_a_power_cut_loses_memory_and_power_comes_back(board: NewBoard) -> None:
    b = board("watchdog")
    machine = b.machine
    machine.advance_us(30_000)
    assert b.result(1) == 1
    machine.power_cut()
    machine.advance_us(1_000_000)
    assert machine.reset_count == 1
    machine.rcc.csr |= RESET_SOFTWARE
    machine.power_on()
    machine.advance_us(1000)
    assert b.result(2) & 0xFC000000 == RESET_POWER | RESET_PIN
    assert b.result(1) == 1


def test_a_crystal_that_dies_stops_a_core_without_the_security_system(board: NewBoard) -> None:
    b = board("systick")
    machine = b.machine
    machine.advance_us(50_000)
    ticks = b.result(0)
    machine.rcc.kill_crystal()
    machine.advance_us(50_000)
    assert b.result(0) == ticks


def test_the_security_system_falls_back_and_calls_once(board: NewBoard) -> None:
    b = board("security")
    machine = b.machine
    machine.advance_us(5_000)
    assert machine.rcc.hclk_ticks * 72 == 40320
    machine.rcc.kill_crystal()
    before = b.result(4)
    machine.advance_us(1_000)
    assert b.result(0) == 1
    assert b.result(1) & 0x80
    assert b.result(2) & 0x030B0000 == 0, "HSE, PLL and CSS are off"
    assert b.result(3) & 0xF == 0, "HSI is the clock"
    assert b.result(4) > before
    assert machine.rcc.hclk_ticks * 8 == 40320


def test_slicing_changes_nothing(board: NewBoard) -> None:
    whole, sliced = board("nesting"), board("nesting")
    whole.machine.advance_us(400)
    while sliced.machine.now < whole.machine.now:
        sliced.machine._step(min(sliced.machine.now + 20_000, whole.machine.now))
    assert bytes(whole.machine.cpu.ram) == bytes(sliced.machine.cpu.ram)
    assert whole.machine.cpu.instructions == sliced.machine.cpu.instructions


def test_bin_hex_and_elf_give_the_same_bytes(build: Callable[[str], Path]) -> None:
    from plumb.flash.image import load_image

    elf = build("clock")
    images = {load_image(elf.with_suffix(suffix)) for suffix in (".elf", ".bin", ".hex")}
    assert len(images) == 1
    assert struct.unpack_from("<I", images.pop())[0] == 0x20005000


def test_what_is_no_image_is_refused_in_a_sentence(tmp_path: Path, build: Callable[[str], Path]) -> None:
    from plumb.errors import UsageError
    from plumb.flash.image import find_image, load_image

    lines = build("clock").with_suffix(".hex").read_bytes().split()
    lines[1] = lines[1][:-1] + (b"0" if lines[1][-1:] != b"0" else b"1")
    for name, content, words in (
        ("a.bin", b"not an image at all", "vector table"),
        ("a.elf", b"\x7fELF\x01\x01" + b"\0" * 60, "32-bit Arm"),
        ("a.elf", b"\x7fELF\x01", "damaged"),
        ("a.hex", b"\n".join(lines), "line 2"),
        ("a.hex", b":0G000001FF", "line 1"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(UsageError, match=words):
            load_image(path)
    with pytest.raises(UsageError, match="make image"):
        find_image(tmp_path / "none.bin")


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """A terminal's Ctrl-C and a SIGTERM, also where the tests run in the background of a shell, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler), signal.signal(signal.SIGTERM, raise_at_once)
    yield
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])
    raised.clear()


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(("number", "ending"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)])
def test_a_signal_inside_a_register_access_ends_the_run_and_not_the_access(
    board: NewBoard, monkeypatch: pytest.MonkeyPatch, number: int, ending: type[BaseException]
) -> None:
    b = board("systick")
    whole: list[int] = []
    read = b.machine.bus.read

    def interrupted(address: int, width: int) -> int:
        if not whole:
            os.kill(os.getpid(), number)
        whole.append(read(address, width))
        return whole[-1]

    monkeypatch.setattr(b.machine.bus, "read", interrupted)
    with pytest.raises(ending):
        b.machine.advance_us(10_000)
    assert len(whole) == 1 and b.machine.now_us < 10_000
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) is raise_at_once
    b.machine.advance_us(1000)
    assert len(whole) > 1


def test_without_unicorn_the_extra_is_named() -> None:
    program = (
        "import sys; sys.modules['unicorn'] = None; sys.path.insert(0, sys.argv[1])\n"
        "from plumb.errors import UsageError\n"
        "from plumb.boards.virtual_machine import open_machine\n"
        "try:\n    open_machine()\n"
        "except UsageError as error:\n    print(error)\n"
    )
    host = str(Path(__file__).parents[2] / "host")
    said = subprocess.run([sys.executable, "-c", program, host], capture_output=True, text=True, check=True)
    assert said.stdout == f"the virtual board needs unicorn; install it {install_hint('virtual')}\n"


def test_tasks_on_process_stacks_take_turns(board: NewBoard) -> None:
    b = board("tasks")
    b.machine.advance_us(50_000)
    switches = b.result(7)
    assert switches == 49, "one at each SysTick of 1 ms, whose first is a little after 1 ms"
    assert min(b.result(0), b.result(1)) > 0.9 * max(b.result(0), b.result(1)) > 1000
    assert (b.result(4), b.result(5)) == (2, 2), "tasks run on the process stack"
    assert b.result(6) == 0, "a handler runs on the main stack"
    assert (b.result(8), b.result(9)) == (0, 0), "r8 of a task survives, and main is never returned to"


def test_snapshots_keep_both_stack_pointers(board: NewBoard) -> None:
    b = board("tasks")
    b.machine.advance_us(10_500)
    kept = b.machine.snapshot()
    b.machine.advance_us(20_000)
    first = bytes(b.machine.cpu.ram)
    b.machine.restore(kept)
    b.machine.advance_us(20_000)
    assert bytes(b.machine.cpu.ram) == first


def test_an_exc_return_that_contradicts_the_active_exceptions_is_a_usage_fault(board: NewBoard) -> None:
    b = board("fault", faults="run")
    b.ask(0, 9)
    b.ask(7, 1)
    b.machine.advance_us(20)
    assert (b.result(2), b.result(4)) == (FAULT_USAGE, 1 << 18), "INVPC"


def test_bit_band_words_are_single_bits_of_ram_and_registers(board: NewBoard) -> None:
    b = board("bits")
    b.ask(8, 0)
    b.ask(9, 0)
    b.machine.advance_us(1000)
    assert b.result(0) == 101
    assert b.result(1) == 0x80100080
    assert b.result(2) == 0x4004
    assert b.result(3) == 1 and b.machine.pin("PA0") is True
    assert (b.result(4), b.result(10)) == (1, 1)


def test_a_bit_band_word_without_memory_behind_it_is_a_fault_or_named(board: NewBoard) -> None:
    from plumb.f103 import SimulationError

    behind = board("bits", faults="run")
    behind.ask(8, 1)
    behind.machine.advance_us(1000)
    assert behind.machine.scb.bfar == 0x22000000 + 32 * 20480
    unknown = board("bits")
    unknown.ask(8, 0)
    unknown.ask(9, 1)
    with pytest.raises(SimulationError, match="0x40005C00"):
        unknown.machine.advance_us(1000)


def test_a_fault_ends_the_run_and_says_why_and_where(board: NewBoard) -> None:
    from plumb.f103 import FaultStop

    b = board("fault", suffix=".elf")
    b.ask(0, 3)
    b.ask(7, 0)
    with pytest.raises(FaultStop) as caught:
        b.machine.advance_us(1000)
    fault = caught.value.fault
    assert str(fault).startswith("HardFault after ")
    assert "an instruction that the core does not have (UNDEFINSTR), pc 0x080" in str(fault)
    assert re.search(r" in main \(fault\.c:\d+\) \(lr 0x[0-9A-F]{8}, sp 0x20", str(fault))
    top = bytes(b.machine.cpu.ram[fault.sp - 0x20000000 :])
    assert fault.stack == struct.unpack(f"<{len(top) // 4}I", top), "the words between the stack pointer and its top"
    b.machine.advance_us(1000)
    assert b.result(1) == 1, "the handler runs when time goes on"
    assert b.machine.program_faults == [fault]


@pytest.mark.parametrize(
    ("cause", "name", "why"),
    [
        (1, "HardFault at 0x60000000", "a load or store that its address does not take (PRECISERR)"),
        (8, "HardFault", "does not fit: the stack pointer is outside RAM (STKERR)"),
        (10, "UsageFault", "a jump to an even address, which asks for Arm instructions (INVSTATE)"),
        (11, "HardFault", "a breakpoint instruction without a debugger (DEBUGEVT)"),
        (12, "UsageFault", "an instruction of a coprocessor; the Cortex-M3 has none, and no floating point (NOCP)"),
    ],
)
def test_a_fault_says_its_cause_in_words(board: NewBoard, cause: int, name: str, why: str) -> None:
    from plumb.f103 import FaultStop

    b = board("fault")
    b.ask(0, cause)
    b.ask(7, int(name == "UsageFault"))
    with pytest.raises(FaultStop, match=re.escape(why)) as caught:
        b.machine.advance_us(1000)
    assert str(caught.value).startswith(name)
