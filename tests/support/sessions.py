"""Sessions with boards in memory and with the flash image, and lines that damage what they carry."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from plumb.boards.virtual_can import MachineBus
from plumb.f103.machine import Machine
from plumb.link.identity import NackError
from plumb.link.session import Session
from plumb.spec import parameters
from support.flash_image import image_path
from support.native_board import UartBoard
from support.pins import at_rest

CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
"""The control words of the default table."""
BOOT_US = 30_000
"""The flash image answers this long after power-up."""
STEER = 1 << 28
"""A setpoint of 22.5 degrees."""


def armed_session(board: UartBoard, period_us: int = 1000) -> Session:
    session = Session.open(board)
    session.upload(CONTROL, period_us=period_us)
    session.begin("REALTIME_LIVE")
    session.arm()
    assert board.armed
    return session


def opened(machine: Machine, link: str) -> Session:
    return Session.over(MachineBus(machine)) if link == "can" else Session.open(machine.uart)


def listen(session: Session, seconds: float) -> None:
    end = session.clock() + seconds
    while session.clock() < end:
        session.receive(0.005)


def used_setpoints(session: Session) -> list[int]:
    """The values of SETPOINT_USED that come from here on."""
    used = session.protocol["SETPOINT_USED"]
    found: list[int] = []

    def note(frames: list[tuple[int, bytes]]) -> None:
        found.extend(used.decode(data)["setpoint"] for identifier, data in frames if identifier == used.identifier)

    session.listener = note
    return found


def refusal(request: Callable[[], object]) -> str:
    with pytest.raises(NackError) as refused:
        request()
    return refused.value.reason


class BadLine:
    """Flips, drops and doubles bytes at random, seeded."""

    def __init__(self, seed: int, rate: float) -> None:
        self._rng, self._rate = random.Random(seed), rate

    def __call__(self, data: bytes) -> bytes:
        out = bytearray()
        for byte in data:
            if self._rng.random() >= self._rate:
                out.append(byte)
                continue
            kind = self._rng.randrange(3)
            out += bytes([byte ^ 1 << self._rng.randrange(8)]) if kind == 0 else bytes([byte]) * (kind - 1) * 2
        return bytes(out)


def booted() -> Machine:
    """A board of this image whose sensors rest, ready to be greeted."""
    machine = Machine(image_path())
    at_rest(machine)
    machine.advance_us(BOOT_US)
    return machine
