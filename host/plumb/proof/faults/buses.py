"""Faults of buses and lines: UART, CAN, and I2C with its chips."""

from __future__ import annotations

import random
from collections.abc import Callable

from plumb.f103.attached.canwire import BIT_RECESSIVE, STUFF, WireFrame
from plumb.f103.machine import Machine
from plumb.f103.peripherals.usart import FE, NE, ORE
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.frames import Stranger
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import ESTIMATE, Scene

SILENCE = Told("EVENTS", "disarm_cause", 1 << 5)
UART_FAULT = Told("STATUS", "faults", 1 << 9)
REJECTED = Told("COUNTERS", "rejected")
BUS_OFF = (Told("CAN_HEALTH", "bus_off", 1), Told("CAN_HEALTH", "bus_offs"))
CHIPS = frozenset({"chips"})
TROUBLE_S = 0.1
CHUNK_S = 0.005
BYTES_PER_S = 92_160
"""Rate of a UART at 921600 baud."""


def uart(send: Callable[[Machine, bytes], object], seconds: float = TROUBLE_S) -> Action:
    """The line carries random bytes instead of the host's for this long."""

    def inject(scene: Scene) -> None:
        chance = random.Random(1)
        end_s = scene.now_s + seconds
        while scene.now_s < end_s:
            send(scene.machine, chance.randbytes(int(BYTES_PER_S * CHUNK_S)))
            scene.run(CHUNK_S)

    return inject


def garbage(machine: Machine, data: bytes) -> None:
    machine.uart.write(data)


def endless_line(machine: Machine, data: bytes) -> None:
    machine.uart.write(b"t" * len(data))


def uart_damaged(flag: int) -> Action:
    """For a while, every byte of the host arrives with this error flag and one wrong bit; with ORE no byte arrives."""

    def inject(scene: Scene) -> None:
        usart = scene.machine.usart
        receive = usart.receive

        def receive_damaged(data: bytes, errors: int = 0) -> None:
            receive(bytes(byte ^ 0x10 for byte in data), errors | flag)

        vars(usart)["receive"] = receive_damaged
        scene.run(TROUBLE_S)
        del vars(usart)["receive"]

    return inject


def can_shorted(scene: Scene) -> None:
    """CAN_H and CAN_L shorted: no recessive bit, for a while."""
    scene.machine.can.wire.short(True)
    scene.run(TROUBLE_S)
    scene.machine.can.wire.short(False)


def heard_on_can(scene: Scene) -> None:
    """A node on CAN has greeted: the board sends to both links, and goes off a bus that fails."""
    Stranger(scene, greeted=True)


def can_babbler(scene: Scene) -> None:
    """A broken node sends the most urgent frame without a pause, for a while."""
    scene.machine.can.wire.babble(WireFrame(0, bytes(8)))
    scene.run(TROUBLE_S)
    scene.machine.can.wire.babble(None)


def can_unacknowledged(scene: Scene) -> None:
    """A cable is off for a while: the board's frames are not acknowledged, and the host's do not reach it."""
    wire = scene.machine.can.wire
    scene.host_alive, wire.attached = False, False
    scene.run(TROUBLE_S)
    scene.host_alive, wire.attached = True, True


def can_sends_fail(scene: Scene) -> None:
    """Every attempt of the board to send fails for a while: it goes bus-off, returns, and goes bus-off again."""
    wire = scene.machine.can.wire
    wire.fail_sending.extend([BIT_RECESSIVE] * 4000)
    scene.run(TROUBLE_S)
    wire.fail_sending.clear()


def can_receives_fail(scene: Scene) -> None:
    """Every frame of the host is destroyed for a while."""
    wire = scene.machine.can.wire
    wire.fail_receiving.extend([STUFF] * 4000)
    scene.run(TROUBLE_S)
    wire.fail_receiving.clear()


def sda_stuck(scene: Scene) -> None:
    """A chip holds SDA until it has seen nine clocks."""
    scene.machine.i2c_bus.stick(9)


def sda_shorted(scene: Scene) -> None:
    scene.machine.i2c_bus.short(True)


def i2c_bus_error(scene: Scene) -> None:
    """A misplaced STOP: the peripheral is dead until it is reset."""
    scene.machine.i2c1.bus_error()


def accelerometer_gone(scene: Scene) -> None:
    """The whole bus is unplugged."""
    scene.machine.i2c_bus.slaves.clear()


_LOST = (Told("EVENTS", "disarm_cause", 1 << 3), (Told("SENSORS", "digital", 0xFFFF), Told("SENSORS", "bus_failures")))

_SILENT = (Told("SENSORS", "digital", 0xFFFF), Told("SENSORS", "bus_failures"))
"""Reports of the board for a bus that does not work while nothing is armed."""

FAULTS = (
    Fault("estimate-i2c-sda-stuck", "buses", "a chip holds SDA for nine clocks, and nothing is armed", sda_stuck,
          "sensor", (Told("SENSORS", "bus_failures"),), CHIPS | {ESTIMATE}),
    Fault("estimate-i2c-sda-shorted", "buses", "SDA shorted to ground, and nothing is armed", sda_shorted, "sensor",
          (_SILENT,), CHIPS | {ESTIMATE}),
    Fault("estimate-i2c-unplugged", "buses", "the whole I2C bus unplugged, and nothing is armed", accelerometer_gone,
          "sensor", (_SILENT,), CHIPS | {ESTIMATE}),
    Fault("uart-garbage", "buses", "random bytes on the UART for 100 ms", uart(garbage), "silence",
          (SILENCE, REJECTED)),
    Fault("uart-framing-errors", "buses", "the host's bytes arrive wrong, with framing errors, for 100 ms",
          uart_damaged(FE), "silence", (SILENCE, UART_FAULT)),
    Fault("uart-noise", "buses", "the host's bytes arrive wrong, with the noise flag, for 100 ms",
          uart_damaged(NE), "silence", (SILENCE, UART_FAULT)),
    Fault("uart-overruns", "buses", "the receiver loses every byte for 100 ms", uart_damaged(ORE), "silence",
          (SILENCE, UART_FAULT)),
    Fault("uart-endless-line", "buses", "a line without end for 100 ms", uart(endless_line), "silence", (SILENCE,)),
    Fault("uart-garbage-beside-can", "buses", "random bytes on the UART for 100 ms, armed over CAN", uart(garbage),
          "held", (), link="can", holds=True),
    Fault("can-shorted", "buses", "the bus is held dominant for 100 ms", can_shorted, "closed", (SILENCE, BUS_OFF),
          link="can"),
    Fault("can-babbler", "buses", "a broken node sends identifier 0 for 100 ms", can_babbler, "closed", (SILENCE,),
          link="can"),
    Fault("can-cable-off", "buses", "nobody acknowledges for 100 ms", can_unacknowledged, "closed", (SILENCE,),
          link="can"),
    Fault("can-receive-errors", "buses", "every frame of the host is destroyed for 100 ms", can_receives_fail,
          "closed", (SILENCE,), link="can"),
    Fault("can-bus-off", "buses", "every frame of the board is destroyed for 100 ms: it goes off the bus",
          can_sends_fail, "closed", (SILENCE, BUS_OFF), link="can"),
    Fault("can-shorted-beside-uart", "buses",
          "the bus is held dominant for 100 ms, armed over the UART; a node on CAN listens", can_shorted, "held",
          (BUS_OFF,), prepare=heard_on_can, holds=True),
    Fault("sda-stuck", "buses", "a chip holds SDA for nine clocks", sda_stuck, "sensor", _LOST, CHIPS),
    Fault("sda-shorted", "buses", "SDA shorted to ground", sda_shorted, "sensor", _LOST, CHIPS),
    Fault("i2c-bus-error", "buses", "a misplaced STOP on I2C: one access is repeated", i2c_bus_error, "held",
          (Told("SENSORS", "bus_failures"),), CHIPS, holds=True),
    Fault("i2c-unplugged", "buses", "both chips are off the bus", accelerometer_gone, "sensor", _LOST, CHIPS),
)  # fmt: skip
