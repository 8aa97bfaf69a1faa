"""The bridge on the clock of a board in memory: which samples a run begins with, what is held on to, and why it
disarmed. No thread and no wall clock: time passes when the bridge listens."""

from __future__ import annotations

import pytest

from plumb.bridge.bridge import Bridge
from plumb.bridge.sample_assembler import Samples
from plumb.contract.parameters import quantise
from plumb.link.sample_codec import Said, sample_frames
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec.protocol import Frame, protocol
from plumb.systems.quad import scenarios as quad
from support.native_board import AT_REST, UartBoard
from support.noise import with_noise

PERIOD_US = 20_000
PARAMS = quantise(quad.ADAPTIVE)


class SteadySensor:
    """In the place of the thread that reads a sensor board: whole samples every period of the board's clock, as long as
    it speaks."""

    trouble, ended, generation, quiet_s, spec = "", False, 0, 0.0, "memory"

    def __init__(self, board: UartBoard, setpoint: int) -> None:
        self.board, self.setpoint, self.sent = board, setpoint, 0
        self.speaks = True

    def drain(self) -> list[tuple[float, Frame]]:
        arrived: list[Frame] = []
        while self.sent * PERIOD_US <= self.board.time_us:
            before = 0 if self.sent == 0 else self.setpoint
            if self.speaks:
                raw = with_noise((*AT_REST[:5], self.sent), self.sent)
                arrived += sample_frames(protocol(), self.sent, raw, self.setpoint, Said(before))
            self.sent += 1
        return [(0.0, entry) for entry in arrived]

    def send(self, frames: list[Frame]) -> None: ...
    def start(self) -> None: ...
    def stop(self) -> None: ...


class Joined:
    """A bridge between the two, on a line of 300 kbaud: the upload takes some periods. said: its messages."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, setpoint: int = 0, arm: bool = False) -> None:
        self.said: list[str] = []
        board = UartBoard()
        board.baud(down_ns=33_333, up_ns=33_333)
        self.sensor = SteadySensor(board, setpoint)
        link = {"period_us": PERIOD_US, "arm_hold_ms": 0}
        self.bridge = Bridge(
            "memory",
            "board",
            PARAMS,
            (),
            link,
            arm=arm,
            shadow=True,
            say=self.said.append,
            open_=lambda _: PlumbBus(board),
        )
        monkeypatch.setattr(self.bridge, "sensor", self.sensor)

    def verified(self, steps: int) -> None:
        """One run of so many."""
        self.bridge.run(lambda: self.bridge.steps >= steps)
        assert self.bridge.runs == 1 and self.bridge.shadow is not None and self.bridge.shadow.verdict == "pass"


def test_a_run_begins_with_the_newest_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that came while parameters were uploaded would wait before every later one, and be left out then. One may
    be, when the second sample comes before the first step."""
    joined = Joined(monkeypatch)
    joined.verified(80)
    bridge, sent = joined.bridge, joined.sensor.sent
    assert bridge.unused > 5 and bridge.skipped <= 1
    assert bridge.counted.lost == bridge.skipped
    assert bridge.steps + bridge.unused <= sent <= bridge.steps + bridge.unused + 2


def test_a_setpoint_that_was_said_before_the_run_holds_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    joined = Joined(monkeypatch, setpoint=1 << 24)
    joined.verified(40)
    assert joined.bridge.shadow is not None and set(joined.bridge.shadow._setpoints[2:]) == {1 << 24}


def test_the_reason_of_a_disarm_comes_from_later_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    joined = Joined(monkeypatch, arm=True)

    def over() -> bool:
        joined.sensor.speaks = "armed" not in joined.said or joined.bridge.steps < 40
        return any("the board disarmed" in text for text in joined.said) or joined.bridge.steps > 200

    joined.bridge.run(over)
    assert "armed" in joined.said
    assert [text for text in joined.said if "disarmed" in text] == [
        "the board disarmed: no injected samples come, or old ones, or too many are lost; "
        "it stays so until this is started again"
    ]


def test_samples_that_falter_at_the_start_put_arming_off(monkeypatch: pytest.MonkeyPatch) -> None:
    joined = Joined(monkeypatch, arm=True)

    def over() -> bool:
        joined.sensor.speaks = not 5 < joined.bridge.steps < 30
        return joined.bridge.steps > 150

    joined.bridge.run(over)
    texts = [text for text in joined.said if "armed" in text]
    assert texts[-1] == "armed" and texts.count("armed") == 1
    assert any(text.startswith("not armed yet: the board refused EXECUTE: no injected samples come") for text in texts)


def test_a_split_sample_is_assembled_without_frames_of_another_board() -> None:
    samples, step = Samples(), 7
    setpoint, second, first = sample_frames(protocol(), step, (1, 2, 3, 4, 5, 6), 99)
    assert samples.assemble([(0.1, setpoint)]) == samples.assemble([(0.2, second)]) == []
    assert samples.assemble([(0.3, first), (0.4, second)]) == [(0.3, [setpoint, second, first])]
    assert samples.setpoint == setpoint
    samples.forget()
    assert samples.setpoint is None and samples.assemble([(0.5, first)]) == [(0.5, [first])]


def test_parts_whose_sample_never_came_give_way_to_newer_ones() -> None:
    samples = Samples()
    _, old, _ = sample_frames(protocol(), 7, (1, 2, 3, 4, 5, 6), 99)
    _, new, first = sample_frames(protocol(), 8, (1, 2, 3, 7, 8, 9), 99)
    assert samples.assemble([(0.1, old), (0.2, new), (0.3, first)]) == [(0.3, [new, first])]
