"""Datagrams of phone apps: the published formats are read, anything else is refused, and time is made steady.

The examples are the ones the formats are published with; their sources are named in plumb/systems/phone/inputs/apps.py.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.judging.phone.inputs import apps
from plumb.judging.phone.inputs.apps import MalformedError, Sample, Sensor, parse
from plumb.judging.phone.inputs.resampler import BACKWARD, GAP_S, WAIT_S, Resampler, Step

G = 9.80665
PERIOD_US = 10_000


def sensagram(sensor: str, time_s: float, xyz: Iterable[float]) -> bytes:
    return json.dumps({"type": f"android.sensor.{sensor}", "timestamp": round(time_s * 1e9), "values": [*xyz]}).encode()


def test_sensagram_event_in_the_units_of_the_board() -> None:
    data = b'{"type": "android.sensor.accelerometer", "timestamp": 3925657519043709,\n "values": [0,-0.980665,9.80665]}'
    datagram = parse(data)
    assert datagram.app == "SensaGram"
    assert datagram.samples == [Sample("accel", pytest.approx(3925657.519043709), (0.0, pytest.approx(-0.1), 1.0))]  # type: ignore[arg-type]
    turning = parse(sensagram("gyroscope", 1.5, [math.pi, 0.0, -math.pi / 2]))
    assert turning.samples == [Sample("gyro", pytest.approx(1.5), (pytest.approx(180.0), 0.0, pytest.approx(-90.0)))]  # type: ignore[arg-type]


def test_sensagram_events_of_other_sensors_are_no_samples() -> None:
    for kind in ("android.sensor.magnetic_field", "android.sensor.accelerometer_uncalibrated", "android.gps"):
        assert parse(json.dumps({"type": kind, "timestamp": 1, "values": [1.0]}).encode()).samples == []


def test_sensorstream_packet_with_a_place_before_the_sensors() -> None:
    text = "16836472.12345, 1, 37.7749,-122.4194,15.2, 3, 0.123,9.810,-0.054, 4, 0.001,0.002,-0.001"
    datagram = parse(text.encode())
    assert datagram.app == "Sensorstream"
    accel, gyro = datagram.samples
    assert (accel.sensor, gyro.sensor) == ("accel", "gyro") and accel.time_s == gyro.time_s == 16836472.12345
    assert accel.xyz == pytest.approx([0.123 / G, 9.810 / G, -0.054 / G])
    assert gyro.xyz == pytest.approx(np.degrees([0.001, 0.002, -0.001]))


def test_sensorstream_packet_with_pressure_and_a_sensor_of_a_later_version() -> None:
    read = parse(b"5.0, 85, 1013.2, 3, 0,0,9.8, 4, 0,0,1").samples
    assert [sample.sensor for sample in read] == ["accel", "gyro"]
    assert [sample.sensor for sample in parse(b"5.0, 3, 0,0,9.8, 99, 1,2,3,4, 4, 0,0,1").samples] == ["accel"]


def test_sensorudp_line_with_point_or_comma_and_no_gyroscope() -> None:
    point = parse(b"A, 1234, 1384532190123, 000.1225830, 009.8066500, -000.9806650\n")
    comma = parse(b"A, 1234, 1384532190123, 000,1225830, 009,8066500, -000,9806650\n")
    assert point == comma and point.app == "SensorUDP"
    (sample,) = point.samples
    assert sample.sensor == "accel" and sample.time_s == pytest.approx(1384532190.123)
    assert sample.xyz == pytest.approx((0.0125, 1.0, -0.1), rel=1e-5)
    for other in (
        b"M, 1, 1384532190123, 1.0, 2.0, 3.0\n",
        b"O, 1, 1384532190123, 1.0, 2.0, 3.0\n",
        b"G, 1, 2, 3, 4, 5\n",
    ):
        assert parse(other) == apps.Datagram("SensorUDP", [])


MALFORMED = [
    b"",
    b"\xff\xfe\x00",
    b"hello",
    b"{}",
    b"{",
    b'{"type": 3}',
    b'["type"]',
    b'{"type":"android.sensor.gyroscope"}',
    b'{"type":"android.sensor.gyroscope","timestamp":1,"values":[1,2]}',
    b'{"type":"android.sensor.gyroscope","timestamp":1,"values":[1,2,NaN]}',
    b'{"type":"android.sensor.gyroscope","timestamp":1,"values":[1,2,1e999]}',
    b'{"type":"android.sensor.gyroscope","timestamp":1,"values":[1,2,true]}',
    b'{"type":"android.sensor.gyroscope","timestamp":1,"values":[1,2,[3]]}',
    b'{"type":"android.sensor.gyroscope","timestamp":-1,"values":[1,2,3]}',
    b'{"type":"android.sensor.gyroscope","timestamp":null,"values":[1,2,3]}',
    b'{"type":"android.sensor.gyroscope","timestamp":1' + b"0" * 400 + b',"values":[1,2,3]}',
    b'{"a":' * 700 + b"1" + b"}" * 700,
    b"1.0",
    b"1.0,",
    b"1.0, 3, 1,2",
    b"1.0, 3, 1,2,x",
    b"1.0, 3, 1,2,inf",
    b"nan, 3, 1,2,3",
    b"-5, 3, 1,2,3",
    b"1.0, 3, 1,2,1e7",
    b'{"type":"android.sensor.gyroscope","timestamp":1,"values":[-1e308,1e308,0]}',
    b"A, 1, 1384532190123, 1.0, 2.0",
    b"A, 1, soon, 1.0, 2.0, 3.0",
    b"1.0, 3, 1,2,3" + b" " * 4096,
]


@pytest.mark.parametrize("data", MALFORMED, ids=range(len(MALFORMED)))
def test_what_no_app_sends_is_refused(data: bytes) -> None:
    with pytest.raises(MalformedError):
        parse(data)


def test_bytes_at_random_and_cut_datagrams_raise_nothing_else() -> None:
    rng = np.random.default_rng(1)
    whole = [sensagram("gyroscope", 1.0, [1, 2, 3]), b"1.0, 3, 1,2,3, 4, 1,2,3", b"A, 1, 1384532190123, 1.0, 2.0, 3.0"]
    for data in (bytes(rng.integers(0, 256, rng.integers(0, 64), np.uint8)) for _ in range(5000)):
        refused(data)
    for data in whole:
        for end in range(len(data)):
            refused(data[:end])
        for at in range(len(data)):
            refused(data[:at] + bytes([int(rng.integers(0, 256))]) + data[at + 1 :])


def refused(data: bytes) -> None:
    try:
        parse(data)
    except MalformedError:
        return


def test_a_file_gives_its_datagrams_whatever_stands_between_them(tmp_path: Path) -> None:
    path = tmp_path / "phone.txt"
    path.write_bytes(b'{"type":"a"}{"type":"b"}\n\n1.0, 3, 1,2,3\r\n')
    assert list(apps.read_file(path)) == [b'{"type":"a"}', b'{"type":"b"}', b"1.0, 3, 1,2,3"]
    with pytest.raises(UsageError, match="cannot read"):
        apps.read_file(tmp_path / "nothing.txt")


def ramp(sensor: Sensor, time_s: float) -> Sample:
    """Values that are straight lines over time: their mean over a period is the value at its middle."""
    slope = 3.0 if sensor == "gyro" else -0.5
    return Sample(sensor, time_s, (slope * time_s, 1.0 + slope * time_s, 7.0))


def stream(begin_s: float, end_s: float, gyro_hz: float = 104.0, accel_hz: float = 97.0) -> list[Sample]:
    """Both sensors at rates of their own, in order of time."""
    both = [ramp("gyro", t) for t in np.arange(begin_s, end_s, 1.0 / gyro_hz)]
    both += [ramp("accel", t) for t in np.arange(begin_s + 0.0031, end_s, 1.0 / accel_hz)]
    return sorted(both, key=lambda sample: sample.time_s)


def run(samples: Iterable[Sample], finish: bool = True) -> tuple[list[Step], Resampler]:
    resampler = Resampler(PERIOD_US)
    steps = [step for sample in samples for step in resampler.feed(sample)]
    return steps + (list(resampler.finish()) if finish else []), resampler


def follows_the_ramps(steps: list[Step], origin_s: float) -> None:
    for step in steps:
        middle_s = origin_s + step.time_s + 0.005
        assert step.rate_dps == pytest.approx((3.0 * middle_s, 1.0 + 3.0 * middle_s, 7.0), abs=1e-6)
        assert step.force_g == pytest.approx((-0.5 * middle_s, 1.0 - 0.5 * middle_s, 7.0), abs=1e-6)


@pytest.mark.parametrize("hz", [50.0, 104.0, 417.0])
def test_steps_are_steady_and_lie_on_the_straight_lines(hz: float) -> None:
    steps, resampler = run(stream(100.0, 103.0, gyro_hz=hz))
    assert [round(step.time_s * 100) for step in steps] == list(range(len(steps)))
    assert [step.first for step in steps] == [True] + [False] * (len(steps) - 1)
    assert len(steps) >= 295
    follows_the_ramps(steps, 100.0031)
    counts = resampler.counts
    assert (counts.late, counts.reordered, counts.duplicate, counts.runs) == (0, 0, 0, 1)


def test_a_step_waits_for_what_may_still_come() -> None:
    resampler, made = Resampler(PERIOD_US), []
    for sample in stream(0.0, 2.0):
        made += [(sample.time_s, step) for step in resampler.feed(sample)]
    assert all(now_s >= step.time_s + 0.01 + WAIT_S for now_s, step in made)
    assert max(now_s - step.time_s for now_s, step in made) < 0.01 + WAIT_S + 2 * 0.011


def test_samples_reordered_within_the_wait_change_nothing() -> None:
    ordered = stream(10.0, 13.0)
    swapped = ordered.copy()
    for i in range(20, len(ordered) - 2, 7):
        swapped[i], swapped[i + 2] = swapped[i + 2], swapped[i]
    straight, _ = run(ordered)
    shuffled, resampler = run(swapped)
    assert shuffled == straight
    assert resampler.counts.reordered > 40 and resampler.counts.late == 0


def test_a_duplicate_changes_nothing() -> None:
    ordered = stream(10.0, 11.0)
    doubled, resampler = run([copy for sample in ordered for copy in (sample, sample)])
    assert doubled == run(ordered)[0]
    assert resampler.counts.duplicate == len(ordered)


def test_a_late_sample_is_left_out_and_counted() -> None:
    ordered = stream(10.0, 11.0)
    early, rest = ordered[40], ordered[:40] + ordered[41:]
    wrong = Sample(early.sensor, early.time_s, (1e3, 1e3, 1e3))
    steps, resampler = run([*rest[:60], wrong, *rest[60:]])
    assert resampler.counts.late == 1
    follows_the_ramps(steps, 10.0031)


def test_lost_samples_are_bridged() -> None:
    kept = [sample for sample in stream(10.0, 13.0) if not 11.0 < sample.time_s < 11.5]
    steps, resampler = run(kept)
    assert len(steps) >= 295 and resampler.counts.runs == 1
    assert 0.5 <= resampler.counts.longest_gap_s < 0.53
    follows_the_ramps(steps, 10.0031)


def test_a_second_of_silence_begins_a_new_run() -> None:
    pause_s = GAP_S + 0.1
    steps, resampler = run(stream(10.0, 11.0) + stream(11.0 + pause_s, 12.0 + pause_s))
    assert resampler.counts.runs == 2
    second = next(i for i, step in enumerate(steps) if step.first and i)
    assert steps[second].time_s == 0.0
    follows_the_ramps(steps[second:], 11.0 + pause_s + 0.0031)


def test_one_sensor_falling_silent_makes_no_steps_and_keeps_nothing() -> None:
    steps, resampler = run([sample for sample in stream(0.0, 60.0) if sample.sensor == "gyro" or sample.time_s < 1.0])
    assert 90 <= len(steps) <= 100
    assert len(resampler._tracks["gyro"].time_s) < 2 * 104 * GAP_S


def test_a_clock_that_goes_back_begins_a_new_run() -> None:
    steps, resampler = run(stream(500.0, 502.0) + stream(3.0, 5.0))
    assert resampler.counts.runs == 2 and resampler.counts.late == BACKWARD
    assert sum(step.first for step in steps) == 2
    assert len(steps) > 360


def test_one_sample_of_the_far_future_costs_no_more_than_a_new_run() -> None:
    ordered = stream(10.0, 12.0)
    steps, resampler = run([*ordered[:100], ramp("gyro", 1e6), *ordered[100:]])
    assert resampler.counts.runs == 2
    assert len(steps) > 180
