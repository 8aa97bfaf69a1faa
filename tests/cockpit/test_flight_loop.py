"""A flight by sticks of a page: armed by the switch, flown by the receiver, lost, landed, recorded, replayed."""

from __future__ import annotations

import csv
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb import systems
from plumb.__main__ import main
from plumb.cockpit.steering import trip_loop
from plumb.cockpit.steering.transmitter import Sticks
from plumb.systems.steered import steered
from support.trip_bench import PILOT, TripBench

STEERED = systems.with_part("fly")
pytestmark = pytest.mark.skipif(not STEERED, reason="no declared system has fly.py")

LAYOUTS = Path(__file__).resolve().parents[2] / "examples" / "plotjuggler"


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[TripBench]:
    bench = TripBench(STEERED[0], tmp_path)
    yield bench
    bench.loop.close()


def test_a_flight_is_armed_flown_landed_recorded_and_replayed_to_the_bit(bench: TripBench, tmp_path: Path) -> None:
    ground_m = 0.1
    bench.turn(6.0, on=False)
    assert not bench.loop.state["armed"] and bench.height_m < ground_m
    bench.turn(0.5, on=True)
    assert bench.loop.state["armed"] and bench.loop.state["recording"]["on"]  # type: ignore[index]
    bench.turn(0.9, on=True, throttle=0.52)
    highest_m = bench.height_m
    assert highest_m > 0.3 and bench.loop.state["said"] == "flown"
    assert bench.loop.scene["estimate"] is not None
    bench.turn(5.0, on=True, throttle=0.36)
    assert bench.height_m < ground_m
    bench.turn(0.5, on=False)
    assert not bench.loop.state["armed"]
    bench.turn(trip_loop.REST_S + 1.0, on=False)
    assert bench.loop.state["over"] and bench.loop.state["light"]["colour"] != "red"  # type: ignore[index]
    bench.loop.recording.wait()
    (log,), (report,) = tmp_path.glob("*.plog"), bench.loop.reports
    assert report.parent == tmp_path and report.stat().st_size > 0
    assert main(["replay", str(log), "--board", "native"]) == 0
    assert main(["export", str(log), str(tmp_path / "flight.csv")]) == 0
    assert_every_curve_is_there(tmp_path / "flight.csv")
    with (tmp_path / "flight.csv").open(encoding="utf-8") as file:
        heights_m = [float(row["true_height_m"]) for row in csv.DictReader(file) if row["true_height_m"]]
    assert max(heights_m) >= highest_m - 0.01 and heights_m[0] < ground_m and heights_m[-1] < ground_m
    page = report.read_text(encoding="utf-8")
    assert "true_height_m" in page and "There is no height" not in page


@pytest.mark.slow
def test_the_flash_image_flies_on_the_simulated_chip_in_steps_of_5_ms(tmp_path: Path) -> None:
    bench = TripBench(STEERED[0], tmp_path, board="virtual")
    try:
        bench.arm()
        bench.turn(0.8, on=True, throttle=0.55)
        state = bench.loop.state
        assert bench.height_m > 0.3 and state["said"] == "flown" and state["system"] == f"{STEERED[0]} on virtual"
        assert state["light"]["colour"] == "green"  # type: ignore[index]
        assert bench.loop._capture is not None and 1300 < bench.loop._capture.steps < 1600, "7.3 s"
        assert bench.loop.speed > 0.0
    finally:
        bench.loop.close()


def assert_every_curve_is_there(table: Path) -> None:
    """PlotJuggler's layout draws columns of the CSV, and what it calculates from such."""
    (layout,) = LAYOUTS.glob(f"{STEERED[0]}.xml")
    root = ElementTree.parse(layout).getroot()
    columns = set(table.read_text(encoding="utf-8").partition("\n")[0].split(","))
    sources = {one.text for name in ("linked_source", "additional_sources/*") for one in root.iterfind(f".//{name}")}
    calculated = {one.get("name") for one in root.iterfind(".//snippet")}
    drawn = {one.get("name") for one in root.iterfind(".//curve")}
    axes = {one.get("time_axis") for one in root.iterfind(".//plugin/default")}
    assert calculated and calculated <= drawn and len(drawn) > 10
    assert (drawn - calculated) | sources | axes <= columns


def test_a_pilot_who_falls_silent_in_the_air_is_held_then_landed(bench: TripBench) -> None:
    bench.arm()
    bench.turn(1.1, on=True, throttle=0.5)
    assert bench.height_m > 0.2
    said = set()
    bench.wall_s = 60.0
    for _ in range(200):
        bench.turn(0.1)
        said.add(str(bench.loop.state["said"]))
        if bench.loop.state["over"]:
            break
    assert {"no receiver: held level", "no receiver: landing"} <= said
    assert bench.loop.state["receiving"] is False and bench.height_m < 0.1
    assert bench.loop.state["over"], "nobody speaks, and the vehicle stands on the ground"
    assert any("the receiver was lost" in text for _, text in bench.loop.notes)


def test_only_the_page_that_holds_the_vehicle_steers(bench: TripBench) -> None:
    bench.loop.accept_sticks(PILOT + 1, Sticks(roll=1.0, on=True))
    bench.turn(0.1)
    assert not bench.loop.state["receiving"]
    assert "does not hold" in str(bench.order("run", page=PILOT + 1)["text"])


def test_what_happens_is_seen_and_ends(bench: TripBench) -> None:
    bench.arm()
    for event in steered(STEERED[0]).EVENTS:
        assert bench.order("happen", event)["good"]
        bench.turn(0.15, on=True)
        assert event in bench.loop.state["happening"]  # type: ignore[operator]
    assert bench.order("happen", trip_loop.LOST)["good"]
    bench.turn(0.15, on=True)
    assert trip_loop.LOST in bench.loop.state["happening"]  # type: ignore[operator]
    assert not bench.loop.state["receiving"]


def test_a_new_flight_ends_the_one_that_is_on_and_begins_on_the_ground(bench: TripBench, tmp_path: Path) -> None:
    bench.arm()
    bench.turn(1.0, on=True, throttle=0.55)
    assert bench.height_m > 0.3
    assert bench.order("run")["good"]
    bench.turn(0.2, on=False)
    assert bench.height_m < 0.1 and not bench.loop.state["armed"] and not bench.loop.state["over"]
    bench.arm()
    bench.loop.close()
    assert bench.loop.trips == 2 and len(list(tmp_path.glob("*.plog"))) == 2


def test_other_estimators_see_the_same_samples(bench: TripBench) -> None:
    bench.arm()
    bench.turn(1.0, on=True, throttle=0.5)
    up = bench.loop._vehicles.vehicle.truth(0.0)
    rivals = bench.loop.scene["rivals"]
    assert isinstance(rivals, dict) and set(rivals) == {"VQF", "Mahony"}
    for vertical in rivals.values():
        apart = math.dist(vertical, [up[f"up_{axis}"] for axis in "xyz"])  # the sine of a small angle
        assert 0.0 < math.degrees(apart) < 10.0


def test_a_stop_switches_the_rotors_off(bench: TripBench) -> None:
    bench.arm()
    bench.loop.stop()
    bench.turn(0.3, on=True)
    assert not bench.loop.state["armed"]


def test_a_throttle_that_is_not_low_arms_nothing_and_the_page_says_why(bench: TripBench) -> None:
    bench.turn(6.0, on=False)
    bench.turn(1.0, on=True, throttle=0.5)
    assert not bench.loop.state["armed"] and bench.loop.state["why"]
    assert bench.height_m < 0.1


def test_a_vehicle_that_waits_begins_anew_so_that_its_record_is_short(
    bench: TripBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trip_loop, "WAIT_S", 2.0)
    bench.turn(3.0, on=False)
    assert bench.loop.state["run"] == 2 and bench.loop.trips == 0
