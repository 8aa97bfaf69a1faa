"""The native board for `plumb.boards.serve`: a NativeMcu with the interface of a served board.

It needs neither Unicorn nor a flash image. A plant and the board exchange counts and outputs every FOLLOW_US; on the
simulated chip of `virtual` the plant is sampled at the instant of each conversion instead.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import can

from plumb import systems
from plumb.boards.flash_file import SLOTS_BYTES, KeptSlots
from plumb.boards.native.mcu import NativeMcu, State
from plumb.contract.parameters import quantise
from plumb.contract.scenario import Plant, calibrated_words, sensor_words
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.link.session import Session
from plumb.spec import crsf, declarations
from plumb.spec.protocol import FRAME_DLC
from plumb.systems.contracts import PINS

FOLLOW_US = 1000
"""Interval at which the plant receives the outputs, and the sensors the plant's counts."""
START_US = 50_000
"""Time from power-up until the host connects."""
UART_BYTE_NS = 10_851
"""Time of a byte at 921600 baud."""
RECEIVER_BYTE_NS = round(10e9 / crsf.BAUD)
"""Time of a byte of the radio receiver."""
BITS_PER_FRAME = 130
"""Length of a CAN frame of 8 bytes, some stuff bits included."""
SEND_PATIENCE_S = 0.02
"""A bus that accepts no frame for this long has failed."""


def open_native(
    strap: int,
    slots: bytes = b"",
    system: str | None = None,
    plant: Plant | None = None,
    *,
    calibrated: bool = False,
) -> ServedNative:
    """A board START_US after power-up. strap: the pin set that its strap chooses. slots: contents of its parameter
    slots; without them the system's tuning for the board's own sensors is saved, and the board restarted. plant:
    attached to its sensors and outputs. calibrated: it says that its sensors were."""
    mcu = NativeMcu(power=False)
    if slots:
        ctypes.memmove(mcu.flash, slots, SLOTS_BYTES)
    mcu.wires.strap = strap
    mcu.power_on()
    mcu.run_us(START_US)
    if system is not None and not slots:
        _save_as(mcu, system, calibrated_words(system) if calibrated else {})
        mcu.power_off()
        mcu.power_on()
        mcu.run_us(START_US)
    mcu.wires.receiver_byte_ns = RECEIVER_BYTE_NS
    mcu.wires.uart_in_byte_ns = mcu.wires.uart_out_byte_ns = UART_BYTE_NS
    return ServedNative(mcu, system, plant)


def _save_as(mcu: NativeMcu, name: str, further: Mapping[str, int]) -> None:
    """Save the tuning for the board's own sensors, as `plumb params tuning SYSTEM --save` does."""
    system, live = systems.load(name), systems.load(name, PINS)
    tuning = system.TUNINGS[live.TUNING]
    with Session.open(mcu.uart) as session:
        params = quantise(tuning)
        link = {**params.link_words(), **system.LINK, **sensor_words(system, live.TUNING), **further}
        session.upload(params.words(), period_us=tuning.period_us, **link)
        session.execute_idle("SAVE")


class ServedNative:
    """A NativeMcu with the interface `Served`, and a plant on its wires, whose time 0 is the construction, or the call
    of `attach`. radio: bytes of the radio receiver up to a time of the plant; called every FOLLOW_US."""

    def __init__(self, mcu: NativeMcu, system: str | None = None, plant: Plant | None = None) -> None:
        self.mcu, self.uart, self.plant = mcu, mcu.uart, plant
        declared = declarations.system(system) if system else None
        self._output = declared.output if declared else ""
        self._counts = declared.counts if declared else 0
        self._names = [word.name for word in declared.output_words] if declared else []
        self.radio: Callable[[float], bytes] | None = None
        self._begin_us = self._follow_us = mcu.now_us

    def attach(self, plant: Plant) -> None:
        """Put another plant on the wires; its time 0 is now."""
        self.plant, self._begin_us, self._follow_us = plant, self.mcu.now_us, self.mcu.now_us

    @property
    def now(self) -> int:
        return self.mcu.now_us * TICKS_PER_US

    def run_to(self, ticks: int) -> None:
        """Advance to an instant. The native board has no ROM bootloader: one that enters it is restarted."""
        end_us = ticks // TICKS_PER_US
        while self.mcu.now_us < end_us:
            self.uart.pass_us(min(end_us - self.mcu.now_us, self.let_follow()))
        if self.mcu.state is State.BOOTLOADER:
            self.mcu.power_off()
            self.mcu.power_on()

    def let_follow(self) -> int:
        """Let the plant and the board exchange outputs and counts if that is due; returns the us until the next
        exchange."""
        if self.plant is None:
            return FOLLOW_US
        if self.mcu.now_us >= self._follow_us:
            self._follow(self.plant)
        return self._follow_us - self.mcu.now_us

    def _follow(self, plant: Plant) -> None:
        self._follow_us += FOLLOW_US
        time_s = (self.mcu.now_us - self._begin_us) * 1e-6
        if self.radio is not None and (received := self.radio(time_s)):
            self.mcu.receiver_send(received)
        plant.follow(time_s, dict(zip(self._names, self._outputs(), strict=True)))
        self.mcu.sense(plant.counts(time_s)[: self._counts])  # commands, which follow the counts, come over the link

    def _outputs(self) -> list[int]:
        wires = self.mcu.wires
        match self._output:
            case "BRIDGE":
                return [wires.duty_q15]
            case "WHEELS":
                return list(wires.wheel_duty_q15)
            case _:
                return list(wires.pulse_halfus)[: len(self._names)]


class NativeJoint:
    """Couples a board's CAN with any python-can bus, as plumb.boards.virtual_can.Joint does for a machine."""

    def __init__(self, mcu: NativeMcu, bus: can.BusABC, kbit: int) -> None:
        self._mcu, self._bus = mcu, bus
        self._set_rate(kbit)

    def _set_rate(self, kbit: int) -> None:
        self._mcu.wires.can_kbit = kbit
        self._mcu.wires.can_frame_ns = BITS_PER_FRAME * 1_000_000 // kbit

    def move(self) -> None:
        """Forward the frames that have arrived, in both directions."""
        while (message := self._bus.recv(0)) is not None:
            self._set_rate(getattr(self._bus, "kbit", None) or self._mcu.wires.can_kbit)
            plain = not (message.is_error_frame or message.is_fd or message.is_extended_id or message.is_remote_frame)
            if plain and message.dlc <= FRAME_DLC:
                self._mcu.can_send(message.arbitration_id, bytes(message.data))
        for identifier, data in self._mcu.can_receive():
            frame = can.Message(timestamp=time.time(), arbitration_id=identifier, is_extended_id=False, data=data)
            self._bus.send(frame, timeout=SEND_PATIENCE_S)


class NativeSlots(KeptSlots):
    """The parameters of a served native board in a file."""

    def __init__(self, mcu: NativeMcu, path: Path) -> None:
        self._mcu = mcu
        super().__init__(path)

    def operations(self) -> int:
        return self._mcu.flash_operations

    def slots(self) -> bytes:
        return bytes(self._mcu.flash)[:SLOTS_BYTES]
