"""The speed of a board, as its TIME and the clock of this machine have it."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from plumb.boards.link import LinkBoard
from plumb.boards.native_port import NativePort
from plumb.boards.virtual import VirtualBoard
from plumb.cockpit.pace import BoardSpeed

TIME_EVERY_S = 0.05


@dataclass
class Bench:
    """A board whose time passes at `pace`. wall_s: of the clock outside; time_us: of the board."""

    speed: BoardSpeed
    wall_s: float = 50.0
    time_us: int = (1 << 32) - 2_000_000
    telemetry: dict[str, dict[str, int]] = field(default_factory=dict)

    def run(self, pace: float, seconds: float) -> None:
        """The loop turns every 10 ms; the board sends TIME every 50 ms of its own time."""
        for _ in range(round(seconds / 0.01)):
            self.wall_s += 0.01
            self.time_us += round(0.01e6 * pace)
            stamp = int(self.time_us - self.time_us % (TIME_EVERY_S * 1e6))
            self.telemetry["TIME"] = {"time": stamp & 0xFFFFFFFF}
            self.speed.follow(self)  # type: ignore[arg-type]


class Board(LinkBoard):
    def __init__(self, name: str, runs_on: str, remedy: str) -> None:
        self.name, self.runs_on, self.slow_remedy = name, runs_on, remedy


CHIP = Board("virtual", VirtualBoard.runs_on, VirtualBoard.slow_remedy)
NATIVE = Board("native", NativePort.runs_on, NativePort.slow_remedy)
SERVED = Board("serial:/dev/pts/9", LinkBoard.runs_on, LinkBoard.slow_remedy)


def bench_of(board: LinkBoard, said: list[str]) -> Bench:
    bench = Bench(BoardSpeed(board, said.append, lambda: bench.wall_s))
    return bench


@pytest.mark.parametrize("pace", [1.0, 0.5, 0.03])
def test_the_share_of_real_time_is_that_of_the_boards_own_time(pace: float) -> None:
    said: list[str] = []
    bench = bench_of(CHIP, said)
    bench.run(pace, 2.5)
    assert bench.speed.share is None and not said
    bench.run(pace, 20.0)  # the board's clock begins anew at 2^32 us
    assert bench.speed.share == pytest.approx(pace, rel=0.02)
    assert said[0].startswith(f"the virtual chip runs at {100 * pace:.0f} % of real time") and len(said) == 1


def test_a_slow_chip_is_told_of_the_native_port_and_a_fast_one_of_nothing() -> None:
    said: list[str] = []
    bench = bench_of(CHIP, said)
    bench.run(1.0, 7.0)
    assert bench.speed.hint == ""
    bench.run(0.9, 7.0)
    assert "--port native" in bench.speed.hint and said[-1].endswith(bench.speed.hint)
    bench.run(1.0, 7.0)
    assert bench.speed.hint == "" and said[-1] == "the virtual chip runs in real time again"


def test_a_slow_native_port_is_not_told_of_itself() -> None:
    said: list[str] = []
    bench = bench_of(NATIVE, said)
    bench.run(0.5, 7.0)
    assert bench.speed.hint and "--port" not in bench.speed.hint
    assert said[0].startswith("the native port runs at 50 % of real time")


def test_a_board_over_a_link_is_named_and_a_short_stall_of_this_machine_is_no_slow_board() -> None:
    said: list[str] = []
    bench = bench_of(SERVED, said)
    bench.run(1.0, 9.8)
    bench.run(0.0, 0.2)
    bench.run(1.0, 2.0)
    assert said == ["the board at serial:/dev/pts/9 runs at 98 % of real time"]
    bench.run(0.1, 25.0)
    assert "plumb virtual-board --port native" in said[-1]


def test_a_board_that_is_restarted_is_measured_anew() -> None:
    said: list[str] = []
    bench = bench_of(CHIP, said)
    bench.run(0.5, 5.0)
    assert bench.speed.share == pytest.approx(0.5, rel=0.02)
    bench.time_us = 0
    bench.run(1.0, 0.1)
    assert bench.speed.share is None
    bench.run(1.0, 5.0)
    assert bench.speed.share == pytest.approx(1.0, rel=0.02)
