"""The line of a board's radio receiver, served by `plumb virtual-board` and fed by `plumb sensor-board`."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import threading

import pytest

from plumb import __main__ as front
from plumb.link.realtime import Capture
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.spec import crsf
from plumb.systems.quadrotor import quantise, scenarios
from support.receiver_twin import by_twin

ADDRESS = re.compile(r"socket://127.0.0.1:(\d+)")


@pytest.mark.parametrize(("options", "receiver_word", "roll"), [([], 1, 16403), (["--ppm"], 3, 16363)])
def test_bytes_of_a_served_line_are_the_sticks_of_a_run(options: list[str], receiver_word: int, roll: int) -> None:
    """As bytes, or played as pulses."""
    command = [sys.executable, "-m", "plumb", "virtual-board", "--port", "native", "--strap", "quadrotor"]
    command += ["--serial", "tcp:0", "--receiver", "tcp:0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said.startswith("its radio receiver listens at ")
        (receiver,) = ADDRESS.findall(said)
        serial = ADDRESS.findall(process.stdout.readline())[0]
        params = quantise.quantise(scenarios.TUNINGS["hummingbird"])
        with (
            Session.open(f"socket://127.0.0.1:{serial}") as session,
            socket.create_connection(("127.0.0.1", int(receiver))) as line,
        ):
            session.upload(params.words(), period_us=5000, receiver=receiver_word)
            session.begin("REALTIME_LIVE", frames=RAW_FRAMES[:4])
            capture = Capture(session, raw_frames=set(RAW_FRAMES[:4]))
            session.listener = capture.feed
            end = session.clock() + 5.0
            wanted, seen = [roll, 0, 0, 1], [0]
            while session.clock() < end and seen != wanted:
                line.sendall(crsf.sticks(roll=0.5, on=True))
                session.receive(0.02)
                seen = capture.raw[max(capture.raw)][6:10] if capture.raw else [0]
            assert seen == wanted
            session.end()
        process.send_signal(signal.SIGTERM)


def test_the_sensor_board_sends_the_sticks_of_its_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    received = bytearray()

    def listen(server: socket.socket) -> None:
        client, _ = server.accept()
        with client:
            while part := client.recv(4096):
                received.extend(part)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=listen, args=(server,))
        thread.start()
        port = server.getsockname()[1]
        arguments = ["sensor-board", "quadrotor", "--bus", "udp:0", "--open-loop", "--seconds", "1.5"]
        assert front.main([*arguments, "--sticks", f"tcp:127.0.0.1:{port}"]) == 0
        thread.join()
    rows = by_twin(bytes(received))
    numbers = [row.words[5] for row in rows]
    assert len(rows) > 50 and numbers == list(range(1, len(rows) + 1))
    assert "samples sent" in capsys.readouterr().out


def test_sticks_of_a_system_without_a_receiver_are_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["sensor-board", "quad", "--bus", "udp:0", "--sticks", "tcp:127.0.0.1:1"]) == 2
    assert "quad takes no sticks" in capsys.readouterr().err


def test_pulses_of_no_line_are_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--port", "native", "--ppm"]) == 2
    assert "--ppm plays the frames of --receiver" in capsys.readouterr().err


def test_no_place_for_the_line_is_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--port", "native", "--receiver", "usb"]) == 2
    assert "pty or tcp:PORT" in capsys.readouterr().err
