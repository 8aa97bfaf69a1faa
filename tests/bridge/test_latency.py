"""Latencies of a bridge: the histogram, what is measured, the sentence about a board that is slow, and UDP ports."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.bridge import bus_end
from plumb.bridge.bridge import Bridge, _Run
from plumb.bridge.bus_end import End, carry
from plumb.bridge.latency import STEPS, LatencyHistogram, drawn, short
from plumb.contract.parameters import quantise
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec.protocol import protocol
from plumb.systems.quad import scenarios as quad
from support.native_board import UartBoard


def test_percentiles_are_those_of_the_values_within_a_bucket() -> None:
    values_s = np.random.default_rng(1).lognormal(-8.0, 1.5, 5000)
    histogram = LatencyHistogram()
    for value_s in values_s:
        histogram.note(float(value_s))
    for percent in (1, 50, 95, 99):
        exact_s = np.percentile(values_s, percent, method="inverted_cdf")
        assert exact_s <= histogram.percentile_s(percent) <= exact_s * (1 + 1 / STEPS) + 1e-9
    assert histogram.percentile_s(100) == histogram.max_s == values_s.max()


def test_a_histogram_for_programs_and_for_people() -> None:
    histogram = LatencyHistogram()
    assert drawn(histogram.as_dict()) == ["none"] and short(histogram.as_dict()) == "-"
    histogram.note(0.0003, times=6)
    histogram.note(0.004)
    histogram.note(-1e-6)  # two clocks of one machine may differ by a tick
    said = histogram.as_dict()
    assert (said["count"], said["max_ms"]) == (8, 4.0) and sum(count for _, count in said["buckets"]) == 8
    head, *bars = drawn(said)
    assert head == "8 frames, median 0.303 ms, 95 % within 4, 99 % within 4, all within 4"
    assert [(bar.split()[1], int(bar.split()[-1])) for bar in bars if bar.count("#")] == [
        ("0.001", 1),
        ("0.5", 6),
        ("5", 1),
    ]
    assert [bar.split()[1] for bar in bars][:5] == ["0.001", "0.002", "0.005", "0.01", "0.02"]
    assert short(said) == "0.30/4.00 ms"


def test_carrying_measures_from_the_arrival_to_the_end_of_the_write(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    ends, sent = (End("udp:1"), End("udp:2")), list[int]()

    def slow(frames: list[tuple[int, bytes]]) -> None:
        now[0] += 0.25
        sent.append(len(frames))

    for end in ends:
        monkeypatch.setattr(end, "send", slow)
    for arrived_s in (9.0, 9.5):
        ends[0].arrived.put((arrived_s, (0x100, bytes(8))))
    there, back = LatencyHistogram(), LatencyHistogram()
    looks = iter([False, True])
    carry(*ends, lambda: next(looks), latencies=(there, back))
    assert sent == [2] and (there.count, there.max_s, back.count) == (2, 1.25, 0)
    assert there.percentile_s(50) == pytest.approx(0.75, rel=1 / STEPS)


@pytest.fixture
def session() -> Iterator[Session]:
    with Session(PlumbBus(UartBoard())) as opened:
        opened.connect()
        yield opened


def test_a_board_that_takes_half_the_samples_is_said_to_be_slow(session: Session) -> None:
    said: list[str] = []
    bridge = Bridge("udp:1", "udp:2", None, (), {}, say=said.append)
    run = _Run(bridge, session, quantise(quad.ADAPTIVE))
    now = [0.0]
    run._watch._clock = lambda: now[0]
    message = protocol()["SAMPLE_A"]

    def samples(seconds: float, steps_per_sample: float) -> None:
        steps = float(run.capture.steps)
        for at in range(round(seconds / 0.02)):
            now[0] += 0.02
            steps += steps_per_sample
            run.capture.steps = int(steps)
            run.send_samples([(now[0], [(message.identifier, message.pack(at & 15, 0, 1, 2, 3))])])

    samples(7.0, 1.0)
    assert said == []
    samples(7.0, 0.5)
    assert len(said) == 1
    assert said[0].startswith("the board behind the bridge runs at ")
    assert said[0].endswith(" % of real time: it does not take every sample in time")
    samples(7.0, 1.0)
    assert said[1:] == ["the board behind the bridge runs in real time again"]
    assert bridge.down.count == 1050 - bridge.skipped


def test_a_udp_port_at_which_nobody_answers_is_not_open(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another program may hold it: it takes every datagram, and is no board."""
    monkeypatch.setattr(bus_end, "FIRST_FRAME_HINT_S", 0.0)
    with socket.socket(type=socket.SOCK_DGRAM) as other, socket.socket(type=socket.SOCK_DGRAM) as third:
        for one in (other, third):
            one.bind(("127.0.0.1", 0))
        names = [f"udp:{one.getsockname()[1]}" for one in (other, third)]
        assert front.main(["bridge", *names, "--carry", "--seconds", "0.5", "--json"]) == 3
        captured = capsys.readouterr()
        said = json.loads(captured.out)
        assert said["first"]["opened"] == said["second"]["opened"] == 0
        assert captured.err.count("yet: is anybody there?") == 2
        assert other.recv(100).startswith(b"\r")  # it was spoken to


def test_a_udp_port_counts_as_open_from_its_first_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    message = protocol()["TIME"]
    with socket.socket(type=socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        end = End(f"udp:{peer.getsockname()[1]}")
        end.start()
        try:
            _, address = peer.recvfrom(100)
            assert end.flow.opened == 0
            from plumb.link.transports.slcan import text_of_frames

            peer.sendto(text_of_frames([(message.identifier, message.pack(0, 0, 1, 2))]), address)
            while not end.flow.frames:
                time.sleep(0.001)
            assert end.flow.opened == 1
        finally:
            end.stop()
