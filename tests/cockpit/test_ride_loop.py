"""A ride by sticks of a page: armed by the switch, driven by the receiver, on ice, lost, over, recorded, replayed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb import systems
from plumb.__main__ import main
from plumb.boards import debugging
from plumb.cockpit import speed
from plumb.cockpit.steering import trip_loop
from plumb.systems.steered import Controls, steered
from support.trip_bench import TripBench

RIDDEN = systems.with_part("ride")
pytestmark = pytest.mark.skipif(not RIDDEN, reason="no declared system has ride.py")
UPRIGHT_DEG, STANDS_MPS = 20.0, 0.2
SPEED, TURN = 0.4, 0.4


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[TripBench]:
    bench = TripBench(RIDDEN[0], tmp_path)
    yield bench
    bench.loop.close()


class Clock:
    """Stands for the module time: it stands still but for sleeping."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def controls() -> Controls:
    return steered(RIDDEN[0]).CONTROLS


def heading_deg(attitude: object) -> float:
    assert isinstance(attitude, list)
    w, x, y, z = attitude
    return math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def test_real_time_begins_when_the_sensors_have_settled(bench: TripBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was simulated faster than that is not waited for: the first seconds would be in slow motion."""
    clock = Clock()
    for module in (speed, debugging):
        monkeypatch.setattr(module, "time", clock)
    bench.loop._paced = True
    bench.turn(bench.loop._steered.SETTLED_S + 0.05, on=False)
    begun_s = clock.now_s
    bench.turn(1.0, on=False)
    assert clock.now_s - begun_s == pytest.approx(1.0, abs=0.02)


def test_a_ride_is_armed_driven_stopped_recorded_and_replayed_to_the_bit(bench: TripBench, tmp_path: Path) -> None:
    bench.arm()
    assert bench.loop.state["recording"]["on"]  # type: ignore[index]
    begin = [heading_deg(bench.loop.scene[name]) for name in ("attitude", "estimate")]
    bench.turn(1.5, on=True, pitch=SPEED, yaw=TURN)
    assert bench.reading("speed") > 0.2 and bench.reading("turn") > 20.0
    tilt = math.radians(bench.reading("tilt"))
    rivals = bench.loop.scene["rivals"]
    assert isinstance(rivals, dict) and set(rivals) == {"VQF", "Mahony"}
    for vertical in rivals.values():
        apart = math.dist(vertical, (-math.sin(tilt), 0.0, math.cos(tilt)))  # the sine of a small angle
        assert 0.0 < math.degrees(apart) < 10.0
    turned = [heading_deg(bench.loop.scene[name]) for name in ("attitude", "estimate")]
    true, estimated = (end - start for start, end in zip(begin, turned, strict=True))
    assert true > 20.0 and abs(estimated - true) < 0.2 * true, "the ghost turns by the sum of the estimated rate"
    bench.turn(1.5, on=True)
    assert abs(bench.reading("speed")) < STANDS_MPS
    bench.turn(0.5, on=False)
    assert not bench.loop.state["armed"]
    bench.turn(trip_loop.REST_S + 1.0, on=False)
    bench.turn(2.0, on=False)
    assert bench.loop.state["over"] and bench.loop.state["light"]["colour"] == "green"  # type: ignore[index]
    assert any(text == "ride 1 is over" for _, text in bench.loop.notes)
    bench.loop.recording.wait()
    (log,), (report,) = tmp_path.glob("*.plog"), bench.loop.reports
    assert report.parent == tmp_path
    text = report.read_text(encoding="utf-8")
    assert '<span class="verdict pass">' in text and "steps equal the model in every bit" in text
    assert "No step was compared" not in text and "<h2>Sticks</h2>" in text
    assert main(["replay", str(log), "--board", "native"]) == 0


def test_a_lost_receiver_leaves_it_standing_and_ends_the_ride_if_it_stays_lost(
    bench: TripBench,
) -> None:
    bench.arm()
    bench.turn(1.5, on=True, pitch=SPEED, yaw=TURN)
    assert bench.order("happen", trip_loop.LOST)["good"]
    bench.turn(trip_loop.LOST_S - 0.1, on=True, pitch=SPEED, yaw=TURN)
    state = bench.loop.state
    assert state["armed"] and not state["over"] and state["said"] == "no receiver: it stands"
    assert abs(bench.reading("speed")) < STANDS_MPS and abs(bench.reading("tilt")) < UPRIGHT_DEG
    bench.turn(1.5, on=True, pitch=SPEED)
    assert bench.loop.state["said"] == "ridden" and bench.reading("speed") > 0.2
    bench.wall_s = 60.0
    bench.turn(trip_loop.REST_S + 2.0)
    state = bench.loop.state
    assert state["receiving"] is False and state["over"], "nobody steers, and the vehicle stands"
    assert not bench.loop._armed and abs(bench.reading("tilt")) < UPRIGHT_DEG


def test_a_rider_who_leaves_stops_it(bench: TripBench, controls: Controls) -> None:
    bench.arm()
    assert bench.order("happen", controls.event)["good"]
    bench.turn(1.0, on=True)
    assert "the rider has left" in str(bench.loop.state["said"])
    bench.turn(2.0, on=True)
    state = bench.loop.state
    assert not state["armed"] and not any(bench.loop.scene["motors"])  # type: ignore[arg-type]
    assert str(state["why"]).startswith("disarmed: ") and "rider" in str(state["why"]), state["why"]
