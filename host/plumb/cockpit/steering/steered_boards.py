"""The boards that are steered: the native one, and the flash image on the simulated chip."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from plumb import systems
from plumb.boards.link import LinkBoard
from plumb.contract.parameters import ControlParams
from plumb.contract.scenario import sensor_words
from plumb.link.session import Session
from plumb.spec import images
from plumb.systems.contracts import PINS
from plumb.systems.steered import SteeredVehicle, steered

Radio = Callable[[float], bytes]
"""Bytes of the radio receiver up to a time of the trip."""
NATIVE, VIRTUAL = "native", "virtual"
VIRTUAL_PERIOD_US = 5000
"""Period of the steps on the simulated chip, which takes more of this machine's time for each."""


class SteeredBoard(Protocol):
    """A board with a vehicle on its pins. board: its session may be another one after `configure`; period_us: of its
    steps."""

    @property
    def board(self) -> LinkBoard: ...

    @property
    def period_us(self) -> int: ...

    def configure(self, params: ControlParams, **words: int) -> Session:
        """Make it run with these parameters."""

    def attach(self, vehicle: SteeredVehicle) -> None:
        """Put a vehicle on its pins, whose time 0 is now."""

    def pass_us(self, time_us: int) -> None:
        """Let so much simulated time pass."""


class NativeSteered:
    """The main loop as built for this machine, its lines without delay."""

    def __init__(self, system: str, radio: Radio) -> None:
        from plumb.boards.native.port import NativePort

        self.period_us = int(steered(system).TUNING.period_us)
        self.board = self._port = NativePort(system, None)
        self._port.mcu.wires.uart_in_byte_ns = self._port.mcu.wires.uart_out_byte_ns = 0  # a loop in memory
        self._port.served.radio = radio

    def configure(self, params: ControlParams, **words: int) -> Session:
        self.board.session.upload(params.words(), **words)
        return self.board.session

    def attach(self, vehicle: SteeredVehicle) -> None:
        self._port.served.attach(vehicle)

    def pass_us(self, time_us: int) -> None:
        self._port.uart.pass_us(time_us)


class VirtualSteered:
    """The flash image on the simulated chip, its sensors and its receiver on their pins. image: None is `all`, or the
    system's own where `all` leaves it out."""

    def __init__(self, system: str, radio: Radio, image: Path | None = None) -> None:
        from plumb.boards.virtual import VirtualBoard

        self.period_us = VIRTUAL_PERIOD_US
        self.board = self._virtual = VirtualBoard(image or images.running(system))
        self._system, self._radio, self._begin_s = system, radio, 0.0

    def configure(self, params: ControlParams, **words: int) -> Session:
        from plumb.boards.plant_on_pins import configure_as

        sensors = sensor_words(systems.load(self._system), systems.load(self._system, PINS).TUNING)
        return configure_as(self._virtual, params, **{**sensors, **words})

    def attach(self, vehicle: SteeredVehicle) -> None:
        from plumb.boards.plant_on_pins import FOUND_US

        machine = self._virtual.machine
        machine.i2c_bus.slaves.clear()
        systems.load(self._system, PINS).couple(machine, vehicle)
        self._begin_s = machine.now_s
        machine.advance_us(FOUND_US)

    def pass_us(self, time_us: int) -> None:
        machine = self._virtual.machine
        if received := self._radio(machine.now_s - self._begin_s):
            machine.usart3.receive(received)
        machine.advance_us(time_us)


def steered_board(board: str, system: str, radio: Radio, image: Path | None = None) -> SteeredBoard:
    """The board of that name, `native` or `virtual`. image: the flash image of the latter."""
    return NativeSteered(system, radio) if board == NATIVE else VirtualSteered(system, radio, image)
