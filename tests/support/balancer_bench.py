"""The flash image as a balancer on the pins of the bridge, with its sensors, on the virtual board."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb import systems
from plumb.boards.strap import set_strap
from plumb.boards.virtual_can import MachineBus
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.f103 import Machine
from plumb.f103.attached.adxl345 import Adxl345
from plumb.f103.attached.itg3205 import Itg3205
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.flash.image import find_image
from plumb.link.session import Session
from plumb.physics.motor import FORWARD
from support.kept import as_made
from support.sensor_bench import world

BOOT_US = 60_000


class Balancer:
    """A machine that saved what makes it a balancer, and was switched on with everything wired. link: serial or can.
    image: a flash image; without it `all`."""

    def __init__(self, link: str = "serial", image: Path | None = None) -> None:
        self.link = link
        try:
            self.machine = machine = Machine(find_image(image), faults="run")
        except UsageError as error:
            pytest.skip(str(error))
        machine.advance_us(BOOT_US)
        system = systems.load("balancer")
        words = quantise(system.TUNINGS[system.DEFAULT_TUNING]).values
        with Session.open(machine.uart) as session:
            session.upload(list(words.values()), period_us=system.PERIOD_US, pins=1, arm_hold_ms=0)
            session.execute("SAVE")
        machine.power_cut()
        set_strap(machine, "bridge")
        machine.drive("PB12", True)
        machine.set_hall(FORWARD[0])
        leaning = world((0.1, 0.0, 0.99), 0.01, 1)
        machine.i2c_bus.slaves += [Itg3205(machine, world((0.0, 0.0, 0.0), 0.5, 2)), Adxl345(machine, leaning)]
        machine.tim1.trace = []
        machine.power_on()
        machine.advance_us(BOOT_US)
        self.session: Session | None = None

    @classmethod
    def as_made(cls, link: str = "serial") -> Balancer:
        """Like Balancer(link), made once in a process; the one before is no more."""
        balancer = as_made("balancer", cls)
        balancer.link = link
        return balancer

    def open(self) -> Session:
        return Session.over(MachineBus(self.machine)) if self.link == "can" else Session.open(self.machine.uart)

    def arm(self) -> None:
        if self.session is not None:
            self.session.close()
        self.session = self.open()
        self.session.begin("REALTIME_LIVE")
        self.keep_alive(0.7)
        self.session.arm()
        self.keep_alive(0.05)
        assert self.driving

    def keep_alive(self, seconds: float) -> None:
        assert self.session is not None
        end_s = self.session.clock() + seconds
        while self.session.clock() < end_s:
            self.session.receive(0.005)

    def switched_off(self) -> float | None:
        """When the last gate that was on went off, in us; None while one is on."""
        machine = self.machine
        machine.tim1.settle(machine.now)
        on: set[tuple[int, str]] = set()
        last = 0
        for edge in machine.tim1.trace or []:
            gate = edge.phase, edge.side
            if edge.on:
                on.add(gate)
            elif gate in on:
                on.remove(gate)
                last = edge.time
        return None if on else last / TICKS_PER_US

    @property
    def driving(self) -> bool:
        return self.switched_off() is None

    def off_after_us(self, limit_us: int) -> float:
        """How long from now until every gate is off for good, within the limit."""
        begin_us = self.machine.now_us
        self.machine.advance_us(limit_us)
        off_us = self.switched_off()
        assert off_us is not None
        return max(0.0, off_us - begin_us)

    def why(self) -> tuple[int, int]:
        """What ended the last armed time, and the faults, as the board reports them."""
        assert self.session is not None
        self.session.connect()
        self.session.telemetry.clear()
        while "EVENTS" not in self.session.telemetry or "STATUS" not in self.session.telemetry:
            self.session.receive(0.05)
        return self.session.telemetry["EVENTS"]["disarm_cause"], self.session.telemetry["STATUS"]["faults"] & 0xFF
