"""Send what a board says as MAVLink 2 in UDP datagrams, for ground stations; nothing is received.

HEARTBEAT     once a second: kind of vehicle, armed or not, state
SYS_STATUS    once a second: sensors, voltage and current of a declared battery, counters of the link
ATTITUDE      with every look: angles, and rates where they are received
RC_CHANNELS   with every look: the sticks that the newest step used, of a system with a pilot
SERVO_OUTPUT_RAW  with every look: the outputs as pulses, of a system that moves something and sends them all
"""

from __future__ import annotations

import struct
import time
from pathlib import Path
from typing import Any, BinaryIO

from plumb.errors import UsageError
from plumb.extras import required
from plumb.link.datagrams import Datagrams
from plumb.link.endpoint_names import quoted
from plumb.link.monitor import Snapshot
from plumb.link.selection import RAW_FRAMES
from plumb.spec import declarations
from plumb.spec.protocol import Frame, protocol
from plumb.spec.signals import output_columns
from plumb.systems.mavlink import HALF_US, LOW_US, MIDDLE_US, MavlinkVehicle

SYSTEM_ID, COMPONENT_ID = 1, 1
EVERY_S = 1.0
"""Interval of HEARTBEAT and SYS_STATUS."""
CHANNELS = 18
NO_CHANNEL = NO_VOLTAGE = 0xFFFF
NO_CURRENT = NO_BATTERY = -1
NO_RSSI = 0xFF
SERVOS = 8
"""Outputs of one SERVO_OUTPUT_RAW."""
MOST = 0xFFFF


def require() -> Any:  # Any: pymavlink has no types
    """The dialect `common`. Raises UsageError where pymavlink is not installed."""
    return required("pymavlink.dialects.v20.common", "pymavlink", "--mavlink", "mavlink")


def parse_target(text: str) -> tuple[str, int]:
    """udp:HOST:PORT. Raises UsageError."""
    kind, _, address = text.partition(":")
    host, _, number = address.rpartition(":")
    good = number.isascii() and number.isdigit() and len(number) <= 5 and 0 < int(number) <= 65535
    if kind != "udp" or not host or not good:
        raise UsageError(
            f"{quoted(text)} is no address of a ground station: write udp:HOST:PORT, with a port up to 65535"
        )
    return host, int(number)


class MavlinkStream:
    """Call `feed` with every frame received, and `show` with every look at the board. system: of the board; vehicle: of
    the system, None for one of which a ground station has no picture. tlog: file for what is sent, as ground stations
    keep it. sent: messages by name."""

    def __init__(
        self, target: tuple[str, int], system: str, vehicle: MavlinkVehicle | None, tlog: Path | None = None
    ) -> None:
        """Raises UsageError where pymavlink is missing or the file cannot be written, LinkError for an unknown host."""
        self._dialect = require()
        self._packer = self._dialect.MAVLink(None, srcSystem=SYSTEM_ID, srcComponent=COMPONENT_ID)
        self.sent: dict[str, int] = {}
        self._datagrams = Datagrams(*target)
        self._file = None if tlog is None else _new_file(tlog)
        self._declared, self._vehicle = declarations.system(system), vehicle
        self._rests_us = {name: LOW_US if unit else MIDDLE_US for name, unit in output_columns(system).items()}
        self._inputs: dict[str, int] = {}
        self._setpoint: int | None = None
        self._next_s = float("-inf")

    def begin(self) -> None:
        """A run begins now, with the setpoint 0."""
        self._setpoint = 0

    def feed(self, frames: list[Frame]) -> None:
        for message, data in protocol().known(frames):
            if message.name in RAW_FRAMES:
                self._inputs |= message.decode(data)
            elif message.name == "SETPOINT_USED":
                self._setpoint = message.decode(data)["setpoint"]

    def show(self, snapshot: Snapshot) -> None:
        time_s = float(snapshot["time_s"])
        if time_s >= self._next_s or time_s < self._next_s - EVERY_S:
            self._next_s = time_s + EVERY_S
            self._heartbeat(snapshot)
            self._status(snapshot)
        if snapshot["step"] is None:
            return
        boot_ms = round(time_s * 1e3) & 0xFFFFFFFF
        pulses = self._outputs(snapshot)
        if pulses:
            whole = [*pulses, *(0,) * (SERVOS - len(pulses))]
            self._send(self._packer.servo_output_raw_encode(round(time_s * 1e6) & 0xFFFFFFFF, 0, *whole))
        if self._vehicle is None:
            return
        attitude = self._vehicle.attitude(snapshot)
        if attitude is not None:
            self._send(self._packer.attitude_encode(boot_ms, *attitude))
        channels = [round(value) for value in self._vehicle.channels(self._setpoint, self._commands())]
        if channels:
            whole = [*channels, *(NO_CHANNEL,) * (CHANNELS - len(channels))]
            self._send(self._packer.rc_channels_encode(boot_ms, len(channels), *whole, NO_RSSI))

    def close(self) -> None:
        self._datagrams.close()
        if self._file is not None:
            self._file.close()

    def _outputs(self, snapshot: Snapshot) -> list[int]:
        """Pulses in us, of a duty 1500 and 500 for the full one. While the board is disarmed nothing turns, whatever
        the step asks for. [] while one of them is not received."""
        found = []
        for column, rest_us in self._rests_us.items():
            value = snapshot.get(column)
            if value is None:
                return []
            pulse_us = value if rest_us == LOW_US else MIDDLE_US + HALF_US * value
            found.append(round(pulse_us if snapshot["armed"] else rest_us))
        return found

    def _commands(self) -> dict[str, int]:
        """The commands that the newest step used; {} where the run does not send them."""
        found = {}
        for command, place in zip(self._declared.step_commands, self._declared.command_places(), strict=True):
            words = [self._inputs.get(f"raw_{place + at}") for at in range(command.size)]
            known = [word for word in words if word is not None]
            if len(known) < len(words):
                return {}
            found[command.name] = command.value(known)
        return found

    def _heartbeat(self, snapshot: Snapshot) -> None:
        known, kind = self._dialect, "GENERIC" if self._vehicle is None else self._vehicle.VEHICLE
        armed, faulty = bool(snapshot["armed"]), bool(snapshot["faults"])
        state = "CRITICAL" if armed and faulty else "ACTIVE" if armed else "STANDBY"
        mode = known.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        self._send(
            self._packer.heartbeat_encode(
                getattr(known, f"MAV_TYPE_{kind}"), known.MAV_AUTOPILOT_GENERIC, mode, 0,
                getattr(known, f"MAV_STATE_{state}"),
            )
        )  # fmt: skip

    def _status(self, snapshot: Snapshot) -> None:
        known = self._dialect
        sensors = known.MAV_SYS_STATUS_SENSOR_3D_GYRO | known.MAV_SYS_STATUS_SENSOR_3D_ACCEL
        healthy = 0 if snapshot["faults"] else sensors
        volts, amperes = snapshot["battery_v"], snapshot["battery_a"]
        voltage_mv = NO_VOLTAGE if volts is None else min(round(1e3 * volts), NO_VOLTAGE - 1)
        # a board without a sensor of the current says 0 A
        current_10ma = round(100.0 * amperes) if amperes else NO_CURRENT
        lost = _count(snapshot["host_lost"]) + _count(snapshot["board_lost"])
        rejected = _count(snapshot["host_rejected"]) + _count(snapshot["board_rejected"])
        counted = (_count(snapshot[name]) for name in ("starved_steps", "saturated_steps", "bus_failures"))
        self._send(
            self._packer.sys_status_encode(
                sensors, sensors, healthy, 0, voltage_mv, current_10ma, NO_BATTERY, 0, min(lost + rejected, MOST),
                *counted, 0,
            )
        )  # fmt: skip

    def _send(self, message: Any) -> None:  # Any: pymavlink has no types
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        self._datagrams.send(data)
        if self._file is not None:
            self._file.write(struct.pack(">Q", round(time.time() * 1e6)) + data)
        name = str(message.get_type())
        self.sent[name] = self.sent.get(name, 0) + 1


def _count(value: Any) -> int:  # Any: of a snapshot
    return 0 if value is None else min(int(value), MOST)


def _new_file(path: Path) -> BinaryIO:
    if path.exists():
        raise UsageError(f"{path} exists: choose another name")
    try:
        return path.open("xb")
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror or error}; choose another file") from None
