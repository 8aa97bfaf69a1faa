"""`plumb bridge --mavlink`: pymavlink receives what a board says; nothing is received from it."""

from __future__ import annotations

import json
import math
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from plumb import __main__ as front
from plumb import systems
from plumb.boards.link import LinkBoard
from plumb.contract.parameters import quantise
from plumb.link.session import Session
from plumb.spec.protocol import Frame, protocol
from plumb.systems.mavlink import MAVLINK
from plumb.writers.mavlink_stream import MavlinkStream
from support import mavlink_by_hand
from support.native_board import UartBoard

BODY, VEHICLE = "attitude", "quadrotor"
LEVEL = (0, 0, 0, 0, 0, 2048)
OVER_RIGHT_SIDE = (0, 0, 0, 0, 1024, 1774)
"""Counts of the accelerometer with the right side 30 deg down: up is to the left."""


@pytest.fixture
def station() -> Iterator[Any]:  # Any: pymavlink has no types
    """A ground station, as pymavlink has it, on a free port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
    link.address = f"udp:127.0.0.1:{port}"
    link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    yield link
    link.close()


def received(link: Any) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    while (message := link.recv_match(blocking=False)) is not None:
        found.setdefault(message.get_type(), []).append(message)
    return found


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> UartBoard:
    """With a run of a body that leans to its right, which another host has begun."""
    memory = UartBoard()
    memory.sensors(OVER_RIGHT_SIDE)
    params = quantise(systems.load(BODY).TUNINGS[systems.load(BODY).DEFAULT_TUNING])
    with Session.open(memory) as session:
        session.upload(params.words(), **params.link_words())
        session.begin("REALTIME_LIVE", frames=[f"ATTITUDE_QUATERNION_{part}" for part in "WXYZ"])
    opened = lambda _spec, **_options: LinkBoard("memory", Session.open(memory))  # noqa: E731
    monkeypatch.setattr("plumb.boards.open_link_board", opened)
    return memory


def test_a_ground_station_sees_attitude_heartbeat_and_status_and_the_file_reads_back(
    board: UartBoard, station: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tlog = tmp_path / "sent.tlog"
    command = ["bridge", "memory", "--mavlink", station.address, "--seconds", "2", "--tlog", str(tlog), "--json"]
    assert front.main(command) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    sent, came = json.loads(captured.out), received(station)
    assert {name: len(messages) for name, messages in came.items()} == sent
    assert sent["ATTITUDE"] >= 15 and sent["HEARTBEAT"] == sent["SYS_STATUS"] == 2 and "RC_CHANNELS" not in sent
    newest = came["ATTITUDE"][-1]
    assert math.degrees(newest.roll) == pytest.approx(30.0, abs=1.0) and abs(math.degrees(newest.pitch)) < 1.0
    assert newest.rollspeed == pytest.approx(0.0, abs=0.05) and newest.time_boot_ms > came["ATTITUDE"][0].time_boot_ms
    beat = came["HEARTBEAT"][-1]
    assert (beat.type, beat.base_mode, beat.system_status) == (common.MAV_TYPE_GENERIC, 0, common.MAV_STATE_STANDBY)
    assert beat.get_srcSystem() == 1 and beat.get_seq() > 0
    status = came["SYS_STATUS"][-1]
    assert (status.voltage_battery, status.battery_remaining, status.errors_comm) == (0xFFFF, -1, 0)
    kept = received(mavutil.mavlink_connection(str(tlog)))
    assert {name: len(messages) for name, messages in kept.items()} == sent
    assert kept["ATTITUDE"][-1].roll == newest.roll


def test_what_a_ground_station_sends_is_never_read(board: UartBoard, station: Any) -> None:
    assert front.main(["bridge", "memory", "--mavlink", station.address, "--seconds", "1.2"]) == 0
    assert received(station)["HEARTBEAT"]
    stream = MavlinkStream((station.port.getsockname()), BODY, None)
    stream.show(snapshot(time_s=0.0))
    received(station)
    arm = common.MAV_CMD_COMPONENT_ARM_DISARM
    for _ in range(50):
        station.mav.command_long_send(1, 1, arm, 0, 1, 21196, 0, 0, 0, 0, 0)  # to the port that the datagrams came from
    stream.show(snapshot(time_s=2.0))
    assert stream.sent == {"HEARTBEAT": 2, "SYS_STATUS": 2}
    stream.close()
    assert not board.armed


def snapshot(**values: object) -> dict[str, Any]:
    names = "armed faults host_lost board_lost host_rejected board_rejected starved_steps saturated_steps bus_failures"
    battery = {"battery_v": None, "battery_a": None}
    return {**dict.fromkeys(names.split()), **battery, "faults": [], "step": 7, "time_s": 1.0, **values}


def raw_frames(words: list[int]) -> list[Frame]:
    known = protocol()
    found = []
    for at, name in enumerate(("RAW_A", "RAW_B", "RAW_C", "RAW_D", "RAW_E")[: len(words) // 3]):
        message = known[name]
        found.append((message.identifier, message.pack(0, 0, *words[3 * at : 3 * at + 3])))
    return found


def test_sticks_and_arming_and_the_axes_of_a_vehicle(station: Any) -> None:
    stream = MavlinkStream(station.port.getsockname(), VEHICLE, systems.load(VEHICLE, MAVLINK))
    lean = math.radians(20.0) / 2.0
    pose = {"w": math.cos(lean), "x": 0.0, "y": math.sin(lean), "z": 0.0}
    turns = {"rate_x_dps": 10.0, "rate_y_dps": 20.0, "rate_z_dps": 30.0}
    stream.show(snapshot(time_s=1.0, **pose))
    assert "RC_CHANNELS" not in received(station), "the run has not said its sticks"
    used = protocol()["SETPOINT_USED"]
    stream.feed([(used.identifier, used.pack(0, 0, 3, 16384))])
    stream.feed(raw_frames([0, 0, 0, 0, 0, 2048, 16384, -32767, 8192, 3, 5, 0]))
    stream.show(snapshot(time_s=2.5, armed=True, **pose, **turns))
    came = received(station)
    (attitude,), (channels,), (beat,) = (came[name] for name in ("ATTITUDE", "RC_CHANNELS", "HEARTBEAT"))
    assert math.degrees(attitude.pitch) == pytest.approx(-20.0, abs=1e-3), "the nose is down"
    rates = [math.degrees(value) for value in (attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed)]
    assert rates == pytest.approx([10.0, -20.0, -30.0], abs=1e-3)
    sticks = [getattr(channels, f"chan{number}_raw") for number in range(1, 8)]
    assert sticks == [1750, 1000, 1500, 1375, 2000, 2000, 0xFFFF] and channels.chancount == 6 and channels.rssi == 0xFF
    assert beat.type == common.MAV_TYPE_QUADROTOR and beat.base_mode == common.MAV_MODE_FLAG_SAFETY_ARMED
    assert beat.system_status == common.MAV_STATE_ACTIVE
    stream.show(snapshot(time_s=4.0, armed=True, faults=["the sensor is lost"]))
    assert received(station)["HEARTBEAT"][0].system_status == common.MAV_STATE_CRITICAL
    stream.close()


@pytest.mark.parametrize(
    ("volts", "amperes", "sent"),
    [(None, None, (0xFFFF, -1)), (11.398, 0.0, (11398, -1)), (7.4, 3.21, (7400, 321)), (99.0, 0.0, (0xFFFE, -1))],
)
def test_a_declared_battery_is_in_the_status(
    station: Any, volts: float | None, amperes: float | None, sent: tuple[int, int]
) -> None:
    stream = MavlinkStream(station.port.getsockname(), VEHICLE, None)
    stream.show(snapshot(battery_v=volts, battery_a=amperes))
    status = received(station)["SYS_STATUS"][0]
    assert (status.voltage_battery, status.current_battery) == sent
    stream.close()


def test_a_vehicle_that_leans_and_turns(station: Any) -> None:
    """Forward and to the left are positive in plumb, negative in MAVLink."""
    stream = MavlinkStream(station.port.getsockname(), "wheels", systems.load("wheels", MAVLINK))
    used = protocol()["SETPOINT_USED"]
    stream.feed([(used.identifier, used.pack(0, 0, 3, 0))])
    stream.feed(raw_frames([0, 0, 0, 0, 0, 0, 1, 0, 0, 16384, 0, 8192, 1, 5, 0]))
    stream.show(snapshot(tilt_deg=10.0, turn_rate_dps=20.0))
    came = received(station)
    (attitude,), (channels,) = came["ATTITUDE"], came["RC_CHANNELS"]
    assert math.degrees(attitude.pitch) == pytest.approx(-10.0) and math.isnan(attitude.pitchspeed)
    assert math.degrees(attitude.yawspeed) == pytest.approx(-20.0)
    assert [channels.chan1_raw, channels.chan3_raw, channels.chan4_raw, channels.chan5_raw] == [1750, 1000, 1375, 2000]
    stream.close()


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """A port that receives bytes, without pymavlink."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        yield receiver


QUADROTOR_TYPE, ROVER_TYPE, ARMED_FLAG = 2, 10, 128
"""MAV_TYPE_QUADROTOR, MAV_TYPE_GROUND_ROVER, MAV_MODE_FLAG_SAFETY_ARMED."""
LEANING = {"w": math.cos(0.1), "x": math.sin(0.1), "y": 0.0, "z": 0.0}
FLOWN = {**LEANING, **{f"pulse_{rotor}_us": 1200.0 + 100.0 * rotor for rotor in range(4)}}
RIDDEN = {"tilt_deg": 10.0, "left": 0.5, "right": -0.25}


@pytest.mark.parametrize(
    ("system", "columns", "armed", "kind", "roll", "pitch", "pulses"),
    [
        ("quadrotor", FLOWN, True, QUADROTOR_TYPE, 0.2, 0.0, [1200, 1300, 1400, 1500]),
        ("quadrotor", FLOWN, False, QUADROTOR_TYPE, 0.2, 0.0, [1000, 1000, 1000, 1000]),
        ("wheels", RIDDEN, True, ROVER_TYPE, 0.0, -math.radians(10.0), [1750, 1375]),
        ("wheels", RIDDEN, False, ROVER_TYPE, 0.0, -math.radians(10.0), [1500, 1500]),
    ],
)
def test_the_bytes_say_kind_arming_attitude_battery_and_outputs(
    listener: socket.socket, system: str, columns: dict[str, float], armed: bool, kind: int, roll: float, pitch: float,
    pulses: list[int],
) -> None:  # fmt: skip
    """Read by a parser written from MAVLink's documents."""
    stream = MavlinkStream(listener.getsockname(), system, systems.load(system, MAVLINK))
    stream.show(snapshot(time_s=1.5, armed=armed, battery_v=11.1, battery_a=2.5, **columns))
    came = [mavlink_by_hand.message(listener.recv(300)) for _ in range(4)]
    stream.close()
    assert [(one.system, one.component, one.sequence) for one in came] == [(1, 1, number) for number in range(4)]
    said = {one.name: one.fields for one in came}
    beat, status, attitude, servos = (
        said[name] for name in ("HEARTBEAT", "SYS_STATUS", "ATTITUDE", "SERVO_OUTPUT_RAW")
    )
    assert (beat["type"], beat["base_mode"]) == (kind, ARMED_FLAG if armed else 0)
    assert (status["voltage_battery"], status["current_battery"]) == (11100, 250)
    assert (attitude["roll"], attitude["pitch"]) == pytest.approx((roll, pitch), abs=1e-6)
    assert attitude["time_boot_ms"] == 1500 and servos["time_usec"] == 1_500_000
    assert [servos[f"servo{number}_raw"] for number in range(1, 9)] == [*pulses, *(0,) * (8 - len(pulses))]


def test_outputs_are_not_sent_while_one_of_them_is_not_received(listener: socket.socket) -> None:
    stream = MavlinkStream(listener.getsockname(), VEHICLE, systems.load(VEHICLE, MAVLINK))
    stream.show(snapshot(armed=True, **{**FLOWN, "pulse_2_us": None}))
    assert stream.sent == {"HEARTBEAT": 1, "SYS_STATUS": 1, "ATTITUDE": 1}
    stream.close()


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        ("memory --mavlink 127.0.0.1:14550", 2, "is no address of a ground station: write udp:HOST:PORT"),
        ("memory --mavlink udp:127.0.0.1:99999", 2, "with a port up to 65535"),
        ("memory --mavlink udp:no.such.host.invalid:14550", 3, "UDP to 'no.such.host.invalid' is not possible"),
        ("memory tcp:127.0.0.1:1 --mavlink udp:127.0.0.1:14550", 2, "--mavlink listens to one board: name one BUS"),
        ("memory --mavlink udp:127.0.0.1:14550 --arm", 2, "--mavlink only listens to a board: leave out --arm"),
        ("memory --mavlink udp:127.0.0.1:14550 --tlog .", 2, ". exists: choose another name"),
        ("memory --mavlink udp:127.0.0.1:14550 --tlog none/a.tlog", 2, "cannot write none/a.tlog"),
        ("tcp:127.0.0.1:1", 2, "name two buses: that of the sensor board, and that of the STM32"),
        ("tcp:127.0.0.1:1 tcp:127.0.0.1:2 --tlog a.tlog", 2, "--tlog is for --mavlink"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    board: UartBoard, words: str, code: int, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert front.main(["bridge", *words.split()]) == code
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1, said


def test_a_missing_library_is_one_sentence_before_a_board_is_opened() -> None:
    code = "import sys; sys.modules['pymavlink'] = None; from plumb.__main__ import main; sys.exit(main(sys.argv[1:]))"
    command = ["bridge", "serial:/dev/none", "--mavlink", "udp:127.0.0.1:14550"]
    done = subprocess.run([sys.executable, "-c", code, *command], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "[mavlink]" in done.stderr and done.stderr.count("\n") == 1
