"""The simulated STM32F103: part, memory, peripherals, and simulated time, which passes only in calls that advance it.

    machine = Machine(Path("firmware.bin"))
    machine.adc["PA0"] = lambda t_s: 1.65
    machine.uart.write(b"V\\r")
    machine.uart.read(20)
    machine.advance_us(1000)
    machine.pwm("PB6")                  # Pwm(pulse_us, period_us, enabled)

Two runs with the same calls give the same bytes: nothing here uses a wall clock or unseeded random numbers.
"""

from __future__ import annotations

import contextlib
import random
import signal
import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

from plumb.errors import UsageError
from plumb.f103.core.bus import Bus, Peripheral, SimulationError
from plumb.f103.core.cpu import FLASH_BASE, SYSTEM_BASE, Cpu
from plumb.f103.core.debug import CoreDebug, DbgMcu, Dwt
from plumb.f103.core.nvic import Nvic
from plumb.f103.core.probe import Probe
from plumb.f103.core.program_fault import Places, ProgramFault
from plumb.f103.core.scb import Scb, SysTick
from plumb.f103.core.timeline import NEVER, TICKS_PER_S, TICKS_PER_US, Timeline
from plumb.f103.debug_hold import DebugHold
from plumb.f103.gdb_server import GdbServer
from plumb.f103.parts import part_named
from plumb.f103.peripherals.adc import PINS as ADC_PINS
from plumb.f103.peripherals.adc import Adc
from plumb.f103.peripherals.backup import Bkp, Pwr
from plumb.f103.peripherals.bxcan import Bxcan
from plumb.f103.peripherals.crc import BASE as CRC_BASE
from plumb.f103.peripherals.crc import Crc
from plumb.f103.peripherals.dma import Dma
from plumb.f103.peripherals.exti import Exti
from plumb.f103.peripherals.flash import Flash
from plumb.f103.peripherals.gpio import Afio, Gpio
from plumb.f103.peripherals.i2c import I2c, I2cBus
from plumb.f103.peripherals.iwdg import Iwdg
from plumb.f103.peripherals.rcc import PLLON, Rcc
from plumb.f103.peripherals.spi import Spi
from plumb.f103.peripherals.tim import Pwm, Timer
from plumb.f103.peripherals.tim1 import Bridge, Tim1
from plumb.f103.peripherals.tim2 import REMAPPED_PINS, Tim2
from plumb.f103.peripherals.usart import Usart1, Usart2, Usart3
from plumb.f103.peripherals.wwdg import Wwdg
from plumb.f103.program_image import load_program
from plumb.f103.program_places import ElfPlaces
from plumb.f103.snapshot import Snapshot
from plumb.f103.uart_stream import UartStream
from plumb.flash.rom_model import RomBootloader
from plumb.process_signals import raise_at_once

VoltSource = float | Callable[[float], float]
"""Volts, or a function of simulated seconds that returns volts."""


PWM_PINS = {
    pin: (timer, index)
    for timer, pins in {
        "TIM2": ("PA0", "PA1", "PA2", "PA3"),
        "TIM3": ("PA6", "PA7", "PB0", "PB1"),
        "TIM4": ("PB6", "PB7", "PB8", "PB9"),
    }.items()
    for index, pin in enumerate(pins)
}
PWM_REMAP = {"TIM2": 3 << 8, "TIM3": 3 << 10, "TIM4": 1 << 12}
"""Bits of AFIO_MAPR that move a timer to other pins."""
LOOK_US = 100
MOST_FAULTS = 100
PLL_24MHZ = 4 << 18 | 2
"""RCC_CFGR: HSI / 2 x 6."""
SYSTEM_STACK, SYSTEM_ENTRY = 0x20000200, 0x1FFFF020
SYSTEM_FLASH_SIZE, SYSTEM_UNIQUE_ID, SYSTEM_OPTIONS = 0x7E0, 0x7E8, 0x800


class AdcPins(dict[str, VoltSource]):
    """Pin name -> its voltage source; a pin without a source is at 0 V. Reading a source does not change it.

    before_conversion: pin -> function that is called before each conversion of that pin, in order of time, with the
    sampling instant in simulated seconds: it advances the plant up to then. It is called whatever the pin's source is:
    a pin that a fault holds leaves the plant and its other pins as they are.
    """

    def __init__(self) -> None:
        super().__init__()
        self.before_conversion: dict[str, Callable[[float], None]] = {}

    def __setitem__(self, pin: str, source: VoltSource) -> None:
        if pin not in ADC_PINS:
            raise UsageError(f"'{pin}' is no ADC input; use one of {', '.join(ADC_PINS)}")
        super().__setitem__(pin, source)

    def sampled(self, pin: str, time_s: float) -> float:
        """Volts that a conversion of the pin at time_s samples, after before_conversion has advanced the plant."""
        if pin in self.before_conversion:
            self.before_conversion[pin](time_s)
        source = self.get(pin, 0.0)
        return source(time_s) if callable(source) else source


class FaultStop(SimulationError):
    """The program took a fault, and the machine was not told to run on (faults="run"). fault: what happened. The core
    stands at the first instruction of its handler: letting time pass runs on."""

    def __init__(self, fault: ProgramFault) -> None:
        super().__init__(str(fault))
        self.fault = fault


class Machine:
    """One simulated part with an image in its flash. Raises UsageError for a bad image or part.

    seed: for the contents of uninitialised RAM and the unique id. crystal: False for a dead crystal. flash_size:
    value of the size register, 0xFFFF on some chips; None: the part's size. lse_left_on: earlier firmware left the 32
    kHz oscillator on PC14 and PC15 running. faults: "stop": a fault of the program ends the call that lets time pass
    with FaultStop; "run": its handler runs, as on silicon. Both note it in `program_faults`. offset: of a program in
    flash that a boot loader stands before; None: found by its vectors. crystal_mhz: frequency of HSE, 8, 12, 16 or
    another even number from 4 on.
    """

    WIRING = frozenset({"probe", "debug_hold"})
    cpu: Cpu
    rcc: Rcc
    usart: Usart1
    usart2: Usart2
    usart3: Usart3

    def __init__(
        self,
        image: bytes | Path,
        part: str = "stm32f103c8",
        *,
        seed: int = 1,
        crystal: bool = True,
        flash_size: int | None = None,
        lse_left_on: bool = False,
        faults: Literal["stop", "run"] = "stop",
        offset: int | None = None,
        crystal_mhz: int = 8,
    ) -> None:
        self.probe: Probe | None = None
        """An instrument on the pins, for example `waveforms.VcdTrace`; snapshots do not keep it."""
        self.debug_hold: DebugHold | None = None
        """A debugger's hold on the machine, which `debug` makes; snapshots do not keep it."""
        self.part = part_named(part)
        program = load_program(image, offset)
        data, self.table = program.data, program.table
        """Offset of the program's vector table in flash, behind a boot loader that is not in the image."""
        if len(data) > self.part.flash_kib * 1024:
            raise UsageError(f"the image has {len(data)} bytes; {part} has {self.part.flash_kib} KiB of flash")
        self.chance = random.Random(seed)
        self.warnings: list[str] = []
        self.stops_at_faults = faults == "stop"
        self.program_faults: list[ProgramFault] = []
        """Faults that the program took, the first MOST_FAULTS."""
        self.places: Places = ElfPlaces.of(image)
        self.powered = True
        self.debugger_attached = False
        self.reset_count = 0
        self.boot0 = False
        """Level of the pin at the next reset: True starts the ROM bootloader."""
        self.rom: RomBootloader | None = None
        self._reset_cause = ""
        self._host_waits = self._stop = False
        self._build()
        self.rcc.crystal_dead = not crystal
        self.rcc.set_crystal(crystal_mhz)
        self.rcc.bdcr = int(lse_left_on)
        self._fill_memory(data)
        if flash_size is not None:
            struct.pack_into("<H", self.cpu.system, SYSTEM_FLASH_SIZE, flash_size)
        self.uart = UartStream(self, self.usart, of_rom=True)
        self.uart2, self.uart3 = UartStream(self, self.usart2), UartStream(self, self.usart3)
        self.adc = AdcPins()
        self._power_up()

    def _build(self) -> None:
        self.cpu = Cpu(self, self.part.flash_kib * 1024, self.part.ram_kib * 1024)
        self.timeline = Timeline(self.cpu.end_slice_at)
        self.bus = Bus(self)
        self.nvic, self.scb, self.systick = Nvic(self), Scb(self), SysTick(self)
        self.core_debug, self.dwt, self.dbgmcu = CoreDebug(self), Dwt(self), DbgMcu(self)
        self.flash, self.rcc, self.dma, self.afio = Flash(self), Rcc(self), Dma(self), Afio(self)
        self.ports = [Gpio(self, letter, 0x40010800 + 0x400 * i) for i, letter in enumerate("ABCDE")]
        self.usart, self.usart2, self.usart3 = Usart1(self), Usart2(self), Usart3(self)
        self.adc1, self.adc2 = Adc(self, "ADC1", 0x40012400), Adc(self, "ADC2", 0x40012800)
        self.converters = (self.adc1, self.adc2)
        self.tim3, self.tim4 = Timer(self, "TIM3", 0x40000400, 29), Timer(self, "TIM4", 0x40000800, 30)
        self.tim1, self.tim2 = Tim1(self), Tim2(self)
        self.i2c_bus = I2cBus(self)
        self.i2c1, self.spi1 = I2c(self, self.i2c_bus), Spi(self)
        self.iwdg, self.wwdg = Iwdg(self), Wwdg(self)
        self.pwr, self.bkp = Pwr(self), Bkp(self)
        self.exti = Exti(self)
        self.crc = Crc(self)
        core: list[Peripheral] = [self.nvic, self.scb, self.systick, self.core_debug, self.dwt, self.dbgmcu]
        rest: list[Peripheral] = [self.flash, self.dma, self.afio, *self.ports, self.usart, self.usart2, self.usart3]
        self.can = Bxcan(self)
        rest += [
            self.adc1,
            self.adc2,
            self.tim1,
            self.tim2,
            self.tim3,
            self.tim4,
            self.i2c1,
            self.spi1,
            self.iwdg,
            self.wwdg,
            self.pwr,
            self.bkp,
            self.can,
            self.crc,
            self.exti,
            self.rcc,
        ]
        for peripheral in core + rest:
            if peripheral.name in self.part.lacks:
                self.bus.lacking.append(peripheral)
            else:
                self.bus.attach(peripheral)
        self.by_name = {peripheral.name: peripheral for peripheral in core + rest}
        for base, size in ((0x40000000, CRC_BASE - 0x40000000), (0xE0000000, 0x100000)):
            self.cpu.map_registers(base, size, self.bus)
        self.cpu.map_registers(CRC_BASE, 0x1000, self.bus, self.crc)
        self.cpu.map_bit_bands(self.bus)

    def _fill_memory(self, image: bytes) -> None:
        cpu = self.cpu
        cpu.flash[:] = b"\xff" * len(cpu.flash)
        cpu.flash[: len(image)] = image
        cpu.system[:] = b"\xff" * len(cpu.system)
        struct.pack_into("<II", cpu.system, 0, SYSTEM_STACK, SYSTEM_ENTRY | 1)
        struct.pack_into("<HH", cpu.system, SYSTEM_FLASH_SIZE, self.part.flash_kib, 0xFFFF)
        cpu.system[SYSTEM_UNIQUE_ID : SYSTEM_UNIQUE_ID + 12] = self.chance.randbytes(12)
        cpu.system[SYSTEM_OPTIONS : SYSTEM_OPTIONS + 4] = bytes((0xA5, 0x5A, 0xFF, 0x00))

    # Power and reset

    def _power_up(self) -> None:
        self.cpu.ram[:] = self.chance.randbytes(len(self.cpu.ram))
        self.bkp.power_lost()
        self.rcc.csr = 0
        self._restart("power")

    def brown_out(self) -> None:
        """The supply dips below the reset threshold: a random half of the RAM's bits is kept, an operation of the flash
        stops in the middle, and the backup registers keep their values."""
        if self.powered:
            kept, random = self.chance.randbytes(len(self.cpu.ram)), self.chance.randbytes(len(self.cpu.ram))
            self.cpu.ram[:] = bytes(r & k | n & ~k & 0xFF for r, k, n in zip(self.cpu.ram, kept, random, strict=True))
            self.rcc.csr = 0
            self._restart("power")

    def _restart(self, cause: str) -> None:
        self._reset_cause = ""
        self.reset_count += 1
        for peripheral in self.bus.peripherals:
            peripheral.reset()
        self.rcc.note_reset(cause)
        self._start_program()
        self.rom = None
        if self.boot0:
            self.enter_rom()
        if self.probe is not None:
            self.probe.restarted(self.now)

    def _start_program(self) -> None:
        """Start from the vectors of the flash's beginning, or do what a boot loader does that is not in the image."""
        behind = self.table and self.cpu.flash[:8] == b"\xff" * 8
        self.cpu.restart(FLASH_BASE + self.table if behind else FLASH_BASE)
        if behind:
            self.scb.vtor = FLASH_BASE + self.table

    # The ROM bootloader: modelled, not executed

    def enter_rom(self) -> None:
        """The core has jumped into system memory: from now on the model of the bootloader owns the UART. The part must
        be in its state after reset."""
        if self.rcc.cfgr or self.rcc.apb1enr or self.rcc.apb2enr:
            self.warn("the ROM bootloader is entered with clocks that a reset has off")
        self.rom = RomBootloader(
            self.cpu.flash, self.flash.store, device_id=self.part.idcode & 0xFFF, extended=self.part.flash_kib > 512
        )

    def rom_receives(self, data: bytes) -> bytes:
        """The bootloader's answer to these bytes. After its command GO the program starts with the bootloader's clock
        and vector table still in force."""
        assert self.rom is not None
        answer = self.rom.receive(data)
        if self.rom.started_at is not None:
            self.cpu.forget_code()
            self.cpu.restart(self.rom.started_at)
            self.rom = None
            self.scb.vtor = SYSTEM_BASE
            self.rcc.write_cfgr(PLL_24MHZ)
            self.rcc.write_cr(self.rcc.cr | PLLON)
        return answer

    def reset(self) -> None:
        """Pull the reset pin."""
        if self.powered:
            self._restart("pin")

    def request_reset(self, cause: str) -> None:
        """Reset the part from inside (cause: software, iwdg, wwdg) after the current instruction."""
        self._reset_cause = cause
        self.cpu.end_slice()

    def power_cut(self) -> None:
        """Switch the supply off: nothing runs until power_on(), and RAM is lost."""
        for peripheral in self.bus.peripherals:
            peripheral.reset()
        self.usart.from_host.clear()
        self.usart2.from_host.clear()
        self.usart3.from_host.clear()
        self.can.wire.power_off()
        self.powered = False

    def power_on(self) -> None:
        if not self.powered:
            self.powered = True
            for slave in self.i2c_bus.slaves:
                slave.brown_out()
            for device in self.spi1.devices.values():
                device.brown_out()
            self._power_up()

    # Snapshots

    def snapshot(self, *others: object) -> Snapshot:
        """Keep the present state: memories, core, peripherals, planned events, bytes on the wires, and the plants and
        sensors that are attached to pins and buses. Call between two calls that advance time. others: objects outside
        the machine to keep with it, such as the session that talks to the board.

        Raises SimulationError for an object that cannot be kept, and while the ROM bootloader runs.
        """
        if self.rom is not None:
            raise SimulationError("no snapshot can be taken while the ROM bootloader runs: reset the board first")
        return Snapshot(self, *others)

    def restore(self, snapshot: Snapshot) -> None:
        """Restore the state of the snapshot; from then on the same calls give the same bytes."""
        if self.cpu.running:
            raise SimulationError("a snapshot cannot be restored while the core runs: end the call that lets time pass")
        hold = self.debug_hold
        snapshot.restore()
        self.debug_hold = hold

    # A debugger

    def debug(self, server: GdbServer | int = 0) -> GdbServer:
        """Let gdb stop this machine, step it and look into it; a program that runs cannot tell.

        Args:
            server: A port of the loopback address, 0 for a free one, or a server that has other machines already.

        Returns:
            The server: `port`, and `close()`, after which the machine is alone again.

        Raises:
            LinkError: The port is taken.
        """
        opened = GdbServer(server) if isinstance(server, int) else server
        self.debug_hold = opened.hold(self, self._step)
        return opened

    # Time

    @property
    def now(self) -> int:
        """Ticks since the machine was created; see timeline.py."""
        return self.cpu.now()

    @property
    def now_us(self) -> float:
        return self.cpu.now() / TICKS_PER_US

    @property
    def now_s(self) -> float:
        return self.cpu.now() / TICKS_PER_S

    def awake_ticks(self) -> int:
        """Ticks during which the core was not asleep."""
        return self.cpu.now() - self.cpu.slept_ticks

    def advance_us(self, duration_us: float) -> None:
        self.run_to(self.now + round(duration_us * TICKS_PER_US))

    def run_until(self, predicate: Callable[[], bool], limit_us: float = 1e6) -> bool:
        """Advance until predicate() holds; False when limit_us passed first. The predicate is evaluated after every
        event and interrupt, and at least every LOOK_US."""
        end = self.now + round(limit_us * TICKS_PER_US)
        with self._interruptible() as step:
            while not predicate():
                if self.now >= end:
                    return False
                step(min(end, self.now + LOOK_US * TICKS_PER_US))
        return True

    def run_to(self, time: int) -> None:
        with self._interruptible() as step:
            while self.cpu.base < time:
                step(time)

    def run_until_sending(self, deadline: int) -> None:
        """Advance until the board begins to send on the UART or CAN, or to the deadline in ticks."""
        self._host_waits, self._stop = True, False
        with self._interruptible() as step:
            while self.cpu.base < deadline and not self._stop:
                step(deadline)
        self._host_waits = False

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[Callable[[int], None]]:
        """Gives the function that makes a step. Within this context Ctrl-C and SIGTERM raise their exception only after
        the core has ended its slice, in a process whose handlers raise one."""
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        main = threading.current_thread() is threading.main_thread()
        raising = [n for n, old in handlers.items() if main and old in (signal.default_int_handler, raise_at_once)]
        for number in raising:
            signal.signal(number, self.cpu.on_interrupt)
        try:
            yield self._step if self.debug_hold is None else self.debug_hold.step
        finally:
            for number in raising:
                signal.signal(number, handlers[number])

    def host_waits_no_more(self) -> None:
        """Ends run_until_sending(): the board has begun to send."""
        if self._host_waits:
            self._stop = True
            self.cpu.end_slice()

    def _step(self, until: int) -> None:
        """Run the events due now, then one exception entry, one slice of instructions, or one stretch of sleep."""
        cpu, timeline = self.cpu, self.timeline
        if timeline.next <= cpu.base:
            timeline.run_due(cpu.base)
        if self._reset_cause:
            self._restart(self._reset_cause)
            return
        asleep = not self.powered or bool(cpu.locked_up) or self.rcc.core_clock_lost
        asleep = asleep or self.flash.busy or self.rom is not None
        masked = False
        if not asleep:
            number = self.nvic.candidate()
            if number:
                if cpu.takes(number):
                    cpu.enter(number)
                    return
                cpu.sleeping, masked = False, True  # a pending exception ends WFI even when PRIMASK masks it
            asleep = cpu.sleeping
        end = min(timeline.next, until)
        if asleep:
            cpu.slept_ticks += 0 if self.flash.busy else end - cpu.base
            cpu.base = end
        elif masked:
            cpu.run_masked(end)
        else:
            cpu.run(max(1, -(-(end - cpu.base) // cpu.instruction_ticks)))

    # Pins

    def port(self, pin: str) -> Gpio:
        """The port of a pin: 'PB6' -> port B. Raises UsageError for another name."""
        port = self.by_name.get("GPIO" + pin[1:2])
        if not isinstance(port, Gpio) or not pin[2:].isdigit() or int(pin[2:]) > 15:
            raise UsageError(f"'{pin}' is not a pin; write PA0 to PE15")
        return port

    def pwm(self, pin: str) -> Pwm:
        """Present waveform at `pin`, as a servo or speed controller sees it."""
        if pin not in PWM_PINS:
            raise UsageError(f"'{pin}' carries no PWM; use one of {', '.join(PWM_PINS)}")
        name, index = PWM_PINS[pin]
        remap = self.afio.mapr & PWM_REMAP[name]
        timer = {"TIM2": self.tim2, "TIM3": self.tim3, "TIM4": self.tim4}[name]
        wave = timer.output(index, self.now)
        if self.powered and wave.enabled and not remap and self.port(pin).is_alternate_output(int(pin[2:])):
            return wave
        return Pwm(0.0, wave.period_us, False)

    def pin(self, pin: str) -> bool | None:
        """Level of a pin; None where it floats."""
        return self.port(pin).level(int(pin[2:]))

    def drive(self, pin: str, level: bool | None) -> None:
        """Drive an input from outside; None: leave it open."""
        self.port(pin).outside[int(pin[2:])] = level
        self.pins_changed()

    def load_pull_up(self, pin: str, rise_us: float) -> None:
        """Load an open pin with wires: its internal pull-up needs rise_us to lift it."""
        self.port(pin).rise_us[int(pin[2:])] = rise_us

    def pins_changed(self) -> None:
        """Tell the peripherals that react to edges that a level may have changed."""
        self.tim1.pins_changed()
        self.tim2.pins_changed()
        self.spi1.pins_changed()
        self.i2c_bus.pins_changed()
        self.exti.pins_changed()
        if self.probe is not None:
            self.probe.pins_changed(self.now)

    def bridge(self) -> Bridge:
        """Present drive of a three-phase bridge on TIM1's pins."""
        return self.tim1.bridge(self.now) if self.powered else Bridge((None, None, None), False)

    def set_hall(self, state: int) -> None:
        """Drive the three Hall inputs of TIM2, remapped: A (PA15) is bit 0, B (PB3) bit 1, C (PB10) bit 2."""
        for bit, pin in enumerate(REMAPPED_PINS):
            self.port(pin).outside[int(pin[2:])] = bool(state >> bit & 1)
        self.pins_changed()

    def duty(self, pin: str) -> float | None:
        """Share of the time that a low side's pin of TIM1 is high when the timer drives it alone; None while it does
        not."""
        return self.tim1.alone(pin, self.now) if self.powered else None

    def turn_encoder(self, timer: str, counts: int) -> None:
        """Turn the encoder on a timer's first two inputs by so many edges, forward where positive."""
        encoder = {"TIM2": self.tim2, "TIM4": self.tim4}[timer]
        encoder.encoded(counts)
        pins = [pin for pin, (name, index) in PWM_PINS.items() if name == timer and index < 2]
        phase = encoder.turned = (encoder.turned + counts) % 4
        for pin, level in zip(pins, (phase in (1, 2), phase in (2, 3)), strict=True):
            self.port(pin).outside[int(pin[2:])] = level
        self.pins_changed()

    # Reports

    def warn(self, text: str) -> None:
        """Record a warning: the firmware did something that silicon tolerates but that is wrong. Each text is kept
        once."""
        if text not in self.warnings:
            self.warnings.append(text)

    def program_faulted(self, fault: ProgramFault) -> None:
        """Note a fault that the program took. Raises FaultStop where faults end the run."""
        fault = replace(fault, place=self.places(fault.pc) if self.stops_at_faults else "")
        if len(self.program_faults) < MOST_FAULTS:
            self.program_faults.append(fault)
        if self.stops_at_faults:
            raise FaultStop(fault)

    def where(self) -> str:
        return f"at {self.now_us:.1f} us, pc near 0x{self.cpu.pc:08X}"

    @property
    def next_event_us(self) -> float | None:
        return None if self.timeline.next == NEVER else self.timeline.next / TICKS_PER_US
