"""Whatever hangs, the outputs are safe within 50 ms: on the flash image, armed and driving, measured at the pins.

The image is patched while it runs (a branch to itself), its interrupts are masked, or its tick is stopped. An ESC's pin
is safe with the neutral pulse or none at all, a gate of the bridge with its switch off. The image is `vehicles`, which
has every handler.
"""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from typing import NamedTuple

import pytest

pytest.importorskip("unicorn")

from plumb.errors import LinkError
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.machine import Machine
from plumb.f103.snapshot import Snapshot
from plumb.flash.elf import Elf
from plumb.flash.thumb import Thumb
from plumb.link.session import Session
from plumb.spec import parameters
from support.balancer_bench import Balancer
from support.pins import at_rest
from support.vehicles_image import vehicles_image

pytestmark = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is not installed")
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
BOOT_US = 30_000
FRAME_US = 20_000
"""The longest there is: a neutral pulse begins with the next frame."""
SAFE_US = 50_000
AFTERWARDS_US = 300_000
NEUTRAL_US = 1000.0
FLASH = 0x08000000
HERE, MASK, MASK_FAULTS, UNDEFINED = 0xE7FE, 0xB672, 0xB671, 0xDE00
"""Machine code: a branch to itself, CPSID I, CPSID F, an instruction that does not exist."""
STALLED, WATCHDOG, HARD = 0x2000, 0x0400, 0x0004
SYSTICK, FIRST_INTERRUPT = 15, 16
SVC_TO_SYSTICK_ENTRY = 14


class Image(NamedTuple):
    elf: Elf
    data: bytes


@pytest.fixture(scope="module")
def image() -> Image:
    built = vehicles_image()
    return Image(Elf(built.with_suffix(".elf")), built.read_bytes())


def patch(machine: Machine, address: int, *code: int) -> bytes:
    """Overwrite instructions of the running image; returns what was there."""
    at = address - FLASH
    before = bytes(machine.cpu.flash[at : at + 2 * len(code)])
    machine.cpu.flash[at : at + len(before)] = struct.pack(f"<{len(code)}H", *code)
    machine.cpu.forget_code()
    return before


def vectors(image: Image) -> dict[int, str]:
    """Exception number -> its handler, without reset and what must not happen."""
    table = struct.unpack_from("<76I", image.data)
    found = {number: image.elf.symbol_at(table[number] & ~1) for number in range(2, 76)}
    return {number: symbol.name for number, symbol in found.items() if symbol and symbol.name != "fault_entry"}


def between_the_pulses(image: Image) -> int:
    """Address of the instruction behind the write of a compare register: the store after that to CR1, from which on the
    address of the first compare register is 0x34 ahead."""
    thumb, pieces = Thumb("this test"), image.elf.code_of(image.elf.symbol("write_pulses"))
    lines = [line for at, code in pieces for line in thumb.instructions(code, at)]
    stores = [i for i, line in enumerate(lines) if thumb.name(line) == "str"]
    assert lines[stores[0]].op_str.endswith("#0x34")
    return int(lines[stores[1] + 1].address)


Hang = Callable[[Machine, Image], object]


def in_function(name: str, *before: int) -> Hang:
    return lambda machine, image: patch(machine, image.elf.symbol(name).address, *before, HERE) and None


def in_handler(name: str) -> Hang:
    """Its interrupt is enabled and pended, so that it comes whether or not the system has a use for it."""

    def inject(machine: Machine, image: Image) -> None:
        patch(machine, image.elf.symbol(name).address, HERE)
        number = next(number for number, handler in vectors(image).items() if handler == name)
        nvic = machine.nvic
        if not nvic.enabled >> number & 1:
            nvic.priority[number] = 0x80
            nvic.enabled |= 1 << number
        nvic.pend(number)

    return inject


def between_the_writes(machine: Machine, image: Image) -> None:
    patch(machine, between_the_pulses(image), HERE)


def with_update_disabled(machine: Machine, image: Image) -> None:
    """As if the loop had hung with UDIS set: no frame takes over what is written."""
    patch(machine, image.elf.symbol("session_poll").address, HERE)
    machine.run_until(lambda: machine.cpu.pc == image.elf.symbol("session_poll").address, 5000)
    machine.tim4.write_cr1(machine.tim4.cr1 | 2)


def without_ticks(machine: Machine, image: Image) -> None:
    machine.systick.write_ctrl(0)


def without_ticks_and_loop(machine: Machine, image: Image) -> None:
    machine.systick.write_ctrl(0)
    patch(machine, image.elf.symbol("session_poll").address, HERE)


def in_the_fault_handler(machine: Machine, image: Image) -> None:
    patch(machine, image.elf.symbol("fault_entry").address, HERE)
    patch(machine, image.elf.symbol("session_poll").address, UNDEFINED)


HANGS: dict[str, Hang] = {
    "loop": in_function("session_poll"),
    "sleep": in_function("board_idle"),
    "loop, interrupts masked": in_function("session_poll", MASK),
    "loop, faults masked": in_function("session_poll", MASK_FAULTS),
    "no ticks": without_ticks,
    "no ticks, loop": without_ticks_and_loop,
    "fault handler": in_the_fault_handler,
}
HANDLERS = (
    "systick_handler", "pendsv_handler", "adc_dma_handler", "spi_dma_handler", "uart_tx_dma_handler",
    "uart_rx_dma_handler", "i2c_dma_handler", "can_tx_handler", "can_rx_handler", "bridge_handler",
    "sampling_timer_handler", "i2c_event_handler", "i2c_error_handler", "uart_handler", "receiver_uart_handler",
    "ppm_capture_handler",
)  # fmt: skip
HANGS |= {name: in_handler(name) for name in HANDLERS}
ESC_HANGS = HANGS | {"between the two pulses": between_the_writes, "update disabled": with_update_disabled}


def test_every_handler_of_the_vector_table_is_tried(image: Image) -> None:
    assert set(vectors(image).values()) == set(HANDLERS)


class RunInputs:
    """A quad that flies on its own sensors; begun once, put back for every hang."""

    def __init__(self, data: bytes, period_us: int = 3000, frame_us: int = FRAME_US) -> None:
        self.machine = machine = Machine(data, faults="run")
        at_rest(machine)
        machine.advance_us(BOOT_US)
        self.session = session = Session.open(machine.uart)
        session.upload(CONTROL, period_us=period_us, esc_period_us=frame_us, arm_hold_ms=0)
        session.begin("REALTIME_LIVE")
        session.arm()
        for _ in range(20):
            session.receive(0.005)
        assert not self.safe
        self._taken: Snapshot = machine.snapshot(session)

    def again(self) -> Machine:
        self.machine.restore(self._taken)
        self.machine.cpu.forget_code()
        return self.machine

    @property
    def safe(self) -> bool:
        waves = [self.machine.pwm(pin) for pin in ("PB6", "PB7")]
        return all(not wave.enabled or wave.pulse_us in (0.0, NEUTRAL_US) for wave in waves)

    def safe_after_us(self) -> float:
        """How long from now until both pins are safe for good."""
        begin = self.machine.now
        last = begin
        while self.machine.now < begin + AFTERWARDS_US * TICKS_PER_US:
            self.machine.advance_us(100 if self.machine.now - begin < 100_000 * TICKS_PER_US else 2000)
            last = last if self.safe else self.machine.now
        return (last - begin) / TICKS_PER_US


@pytest.fixture(scope="module")
def inputs(image: Image) -> RunInputs:
    return RunInputs(image.data)


@pytest.mark.slow
@pytest.mark.parametrize("name", ESC_HANGS)
def test_the_pulses_are_safe_within_50_ms_of_a_hang(inputs: RunInputs, image: Image, name: str) -> None:
    machine = inputs.again()
    ESC_HANGS[name](machine, image)
    after_us = inputs.safe_after_us()
    assert 0 < after_us <= SAFE_US
    assert machine.reset_count > 1, "the window watchdog ends it"


@pytest.fixture(scope="module")
def ride() -> tuple[Balancer, Snapshot]:
    balancer = Balancer(image=vehicles_image())
    balancer.arm()
    return balancer, balancer.machine.snapshot(balancer.session)


@pytest.mark.slow
@pytest.mark.parametrize("name", HANGS)
def test_the_bridge_is_off_within_50_ms_of_a_hang(ride: tuple[Balancer, Snapshot], image: Image, name: str) -> None:
    balancer, taken = ride
    machine = balancer.machine
    machine.restore(taken)
    machine.cpu.forget_code()
    resets = machine.reset_count
    HANGS[name](machine, image)
    assert 0 < balancer.off_after_us(AFTERWARDS_US) <= SAFE_US
    assert machine.reset_count > resets
    assert not machine.bridge().enabled


@pytest.fixture(scope="module")
def slow_flight(image: Image) -> RunInputs:
    """A pause of 15 ms misses no step of it, and neither silences its host for too long."""
    return RunInputs(image.data, period_us=20_000, frame_us=2500)


def pause(machine: Machine, image: Image, duration_us: int) -> None:
    """The loop stands still for so long, and goes on."""
    place = image.elf.symbol("session_poll").address
    before = patch(machine, place, HERE)
    machine.advance_us(duration_us)
    patch(machine, place, *struct.unpack("<H", before))


def status_of(session: Session) -> dict[str, int]:
    session.telemetry.clear()
    while "EVENTS" not in session.telemetry or "STATUS" not in session.telemetry:
        session.receive(0.05)
    return dict(session.telemetry["STATUS"])


@pytest.mark.parametrize(("pause_us", "stalls"), [(15_000, False), (30_000, True)])
def test_a_recovered_loop_is_reported_and_drives_only_in_the_next_run(
    slow_flight: RunInputs, image: Image, pause_us: int, stalls: bool
) -> None:
    """20 ms without a turn are neutral and latched; a new run and arming drive again."""
    inputs = slow_flight
    machine, session = inputs.again(), inputs.session
    pause(machine, image, pause_us)
    for _ in range(5):
        session.receive(0.005)
    assert inputs.safe == stalls and machine.reset_count == 1
    status = status_of(session)
    assert bool(status["faults"] & STALLED) == stalls
    if not stalls:
        return
    assert status["armed"] == 0 and status["blocked"] & 8
    for _ in range(20):
        session.receive(0.005)
        assert inputs.safe
    with pytest.raises(LinkError, match="the board has a fault"):
        session.arm()
    session.begin("REALTIME_LIVE")
    session.arm()
    for _ in range(20):
        session.receive(0.005)
    assert not inputs.safe and status_of(session)["faults"] & STALLED == 0


def test_a_bridge_that_a_stall_switched_off_stays_off_until_the_next_run(
    ride: tuple[Balancer, Snapshot], image: Image
) -> None:
    balancer, taken = ride
    machine = balancer.machine
    machine.restore(taken)
    machine.cpu.forget_code()
    resets = machine.reset_count
    pause(machine, image, 30_000)
    assert balancer.off_after_us(200_000) == 0 and not machine.bridge().enabled
    assert machine.reset_count == resets
    balancer.arm()


@pytest.mark.parametrize(
    ("crystal", "pll_dead"), [(True, False), (False, False), (False, True)], ids=["72 MHz", "64 MHz", "8 MHz"]
)
def test_at_every_clock_a_masked_hang_resets_in_time_and_says_what_it_was(
    image: Image, crystal: bool, pll_dead: bool
) -> None:
    machine = Machine(image.data, crystal=crystal, faults="run")
    machine.rcc.pll_dead = pll_dead
    machine.advance_us(300_000)
    assert machine.reset_count == 1
    place = image.elf.symbol("session_poll").address
    before = patch(machine, place, MASK, HERE)
    begin_us = machine.now_us
    assert machine.run_until(lambda: machine.reset_count == 2, SAFE_US)
    assert machine.now_us - begin_us > 30_000
    assert machine.rcc.csr >> 24 & 0x60 == 0x40
    patch(machine, place, *struct.unpack("<2H", before))
    if not pll_dead:  # a UART of 921600 baud needs more than 8 MHz
        machine.advance_us(300_000)
        with Session.open(machine.uart) as session:
            identity = session.connect()
        assert identity.reset_cause == "window watchdog" and identity["FAULTS"] & WATCHDOG
    assert machine.reset_count == 2


def test_a_watchdog_reset_cancels_a_bootloader_request(image: Image) -> None:
    """The word is in its register and the reset that belongs to it hangs: neither the reset by the watchdog nor a
    software reset after it goes into the ROM."""
    machine = Machine(image.data, faults="run")
    machine.advance_us(BOOT_US)
    machine.bkp.dr1 = 0xB007
    machine.request_reset("wwdg")
    machine.advance_us(BOOT_US)
    assert machine.rom is None and machine.reset_count == 2
    machine.request_reset("software")
    machine.advance_us(BOOT_US)
    assert machine.rom is None and machine.reset_count == 3


def test_systick_alone_interrupts_the_other_handlers(inputs: RunInputs, image: Image) -> None:
    """Priorities as the processor has them: what the bound of the stack counts on."""
    nvic = inputs.again().nvic
    enabled = [number for number in range(SVC_TO_SYSTICK_ENTRY, 76) if nvic.enabled >> number & 1]
    assert len(enabled) > 8
    assert {number: nvic.priority[number] for number in enabled} == {
        number: 0 if number == SYSTICK else 0x80 for number in enabled
    }
    assert nvic.group_mask & 0x80
