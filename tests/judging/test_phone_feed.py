"""A phone's datagrams over loopback to a board: what arrives late, twice, in another order, damaged or from elsewhere.

The phone is the scenario `general`, sent as the apps send it; the truth is the scenario's.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from plumb.boards import open_board
from plumb.boards.contract import RawCounts, StepBoard, StepOutput, Stepper
from plumb.contract.parameters import ControlParams
from plumb.errors import LinkError, UsageError
from plumb.judging.phone.inputs import live_run, udp
from plumb.systems.phone import scenarios as phone
from support.phone_datagrams import SECONDS, run_of, sensagram, sensorstream
from support.phone_feed import Sender, Wrong


@pytest.fixture
def native() -> Iterator[StepBoard]:
    with open_board("native") as board:
        yield board


def fed(
    board: StepBoard, datagrams: list[bytes], seconds: float | None = SECONDS - 0.5
) -> tuple[Any, udp.Intake, list[Any]]:
    """The datagrams over a real socket to a board: outcome, counts, and what was seen of every step."""
    intake, seen = udp.Intake(phone.PERIOD_US), []
    with udp.Listener(0) as listener:
        follower = live_run.Follower(board, live_run.params_of("euler", phone.PERIOD_US))
        sender = Sender(listener.port, datagrams, lambda: intake.received.datagrams)
        sender.start()
        live_run.follow(
            listener, intake, follower, seconds=seconds, wait_s=20.0, stop=[], saw=lambda *now: seen.append(now)
        )
        sender.stopped.set()
        sender.join()
    return follower.outcome, intake, seen


def worst_deg(seen: list[Any], run: phone.Scenario, late_s: float) -> float:
    """Largest angle between the estimated and the true vertical; a step's middle is so much after the run's sample."""
    turn = 360.0 / 2**32
    at_s = np.array([step.time_s for step, _ in seen]) + late_s
    truth = np.stack([np.interp(at_s, run.time_s, axis) for axis in run.vertical])
    pitch, roll = (np.array([words[f"{axis}_turn_q32"] for _, words in seen]) * turn for axis in ("pitch", "roll"))
    return float(phone.inclination_deg(phone.up(pitch, roll), truth)[100:].max())


@pytest.mark.parametrize(("app", "form"), [("SensaGram", sensagram), ("Sensorstream", sensorstream)])
def test_a_phone_over_loopback_is_followed_and_every_step_agrees(
    native: StepBoard, app: str, form: Callable[[phone.Scenario], list[bytes]]
) -> None:
    run = run_of()
    outcome, intake, seen = fed(native, form(run))
    assert outcome.verdict == "pass" and outcome.steps == round((SECONDS - 0.5) * 100)
    assert intake.received.apps.keys() == {app} and intake.received.malformed == 0
    # What the filter may be off by in this motion; an angle or a sign that is wrong costs tens of degrees.
    assert worst_deg(seen, run, late_s=0.008 if app == "SensaGram" else 0.005) < 2.0


def test_trouble_on_the_way_is_counted_and_changes_little(native: StepBoard) -> None:
    """One in ten lost, one in ten doubled, neighbours exchanged, some a second late, garbage in between."""
    run, rng = run_of(), np.random.default_rng(3)
    ordered = sensagram(run)
    rough: list[bytes] = []
    held: list[tuple[int, bytes]] = []
    lost = doubled = damaged = late = 0
    for at, data in enumerate(ordered):
        rough += [old for due, old in held if due == at]
        chance = rng.random()
        if chance < 0.1:
            lost += 1
        elif chance < 0.2:
            rough += [data, data]
            doubled += 1
        elif chance < 0.21 and at + 250 < len(ordered):
            held.append((at + 250, data))
            late += 1
        else:
            rough.append(data)
        if rng.random() < 0.05:
            rough.append(bytes(rng.integers(0, 256, 30, np.uint8)) + b"{")
            damaged += 1
    for i in range(10, len(rough) - 2, 6):
        rough[i], rough[i + 2] = rough[i + 2], rough[i]
    outcome, intake, seen = fed(native, rough)
    counts, received = intake.resampler.counts, intake.received
    assert outcome.verdict == "pass" and counts.runs == 1 and outcome.steps == round((SECONDS - 0.5) * 100)
    # What was on its way at the end is sent, and not received.
    assert received.malformed == pytest.approx(damaged, abs=10) and received.malformed > 20
    assert counts.late == pytest.approx(late, abs=3) and counts.late > 5
    assert counts.duplicate > 0.8 * doubled and counts.reordered > 100 and lost > 150
    # Half more than without trouble: one in ten samples is lost.
    assert worst_deg(seen, run, late_s=0.008) < 3.0


def test_a_second_host_is_left_out_of_the_run_and_of_the_file(tmp_path: Path) -> None:
    run, path = run_of(), tmp_path / "walk.txt"
    with udp.Saved(path) as saved:
        intake = udp.Intake(phone.PERIOD_US, saved)
        good = sensorstream(run)
        assert not list(intake.push(b"nonsense\nof\r\nanybody", "192.0.2.9"))
        steps = [step for data in good[:300] for step in intake.push(data, "192.0.2.1")]
        assert not list(intake.push(good[300], "192.0.2.2"))
        steps += [step for data in good[300:600] for step in intake.push(data, "192.0.2.1")]
        assert path.read_bytes().count(b"\n") == 601, "written as they come"
    assert intake.received.strangers == 1 and len(steps) == 597
    assert intake.received.datagrams == 602
    again, read, _ = udp.steps_of_file(path, phone.PERIOD_US)
    assert again[:597] == steps and (read.received.datagrams, read.received.malformed) == (601, 1)


def test_a_disk_that_is_full_is_said() -> None:
    with udp.Saved(Path("/dev/full")) as saved, pytest.raises(UsageError, match="cannot write /dev/full"):
        saved.write(b"1.0, 3, 1,2,3")


def test_an_app_started_again_begins_a_new_run_on_the_board(native: StepBoard) -> None:
    """Its clock goes on, after a pause; filters and step number begin anew, and the model with them."""
    run = run_of()
    both = sensagram(run, begin_s=100.0)[:800] + sensagram(run, begin_s=300.0)[:800]
    outcome, intake, seen = fed(native, both, seconds=7.0)
    assert outcome.verdict == "pass" and intake.resampler.counts.runs == 2
    numbers = [words["step"] for _, words in seen]
    assert numbers[0] == 1 and numbers.count(1) == 2


def test_a_board_that_goes_wrong_is_found_with_the_word(native: StepBoard) -> None:
    outcome, _, _ = fed(Wrong(native), sensagram(run_of())[:900], seconds=4.0)
    assert outcome.verdict == "fail" and outcome.mismatches >= 1
    assert outcome.divergence is not None
    assert (outcome.divergence.step, outcome.divergence.signal) == (199, "roll_p11")
    whole = outcome.longest.run(None, live_run.params_of("euler", phone.PERIOD_US))
    assert (whole.verdict, whole.mismatches, whole.divergence) == ("fail", 1, outcome.divergence)
    assert len(whole.inputs.raw) == 200, "what is looked for ends the run on the board"
    gone = live_run.Followed(outcome.longest.steps, outcome.longest.digests).run(None, whole.params)
    assert gone.divergence is not None and (gone.divergence.step, gone.divergence.signal) == (199, "digest")


@pytest.mark.parametrize(
    ("datagrams", "sentence"),
    [
        ([], "nothing arrived"),
        ([b"hello"] * 3, "none of a format that is known"),
        ([b"A, 1, 1384532190123, 0.1, 0.2, 9.8"] * 3, "SensorUDP sends no gyroscope; take an app that does"),
        (sensagram(run_of())[::2][:50], "SensaGram sent no accelerometer; switch it on"),
    ],
)
def test_without_a_step_the_reason_is_one_sentence(native: StepBoard, datagrams: list[bytes], sentence: str) -> None:
    intake = udp.Intake(phone.PERIOD_US)
    with udp.Listener(0) as listener:
        follower = live_run.Follower(native, live_run.params_of("euler", phone.PERIOD_US))
        sender = Sender(listener.port, datagrams, lambda: 0)
        sender.start()
        sender.join()
        with pytest.raises(LinkError, match=sentence):
            live_run.follow(listener, intake, follower, seconds=None, wait_s=0.4, stop=[], saw=lambda *_: None)


@pytest.mark.parametrize(
    ("stops", "sentence"),
    [(lambda _: False, "the phone stopped sending"), (lambda data: b"accel" in data, "the phone's gyroscope stopped")],
)
def test_a_phone_that_falls_silent_ends_the_run_and_is_named(
    native: StepBoard, stops: Callable[[bytes], bool], sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_run, "SILENCE_S", 0.5)
    events = sensagram(run_of())
    intake = udp.Intake(phone.PERIOD_US)
    with udp.Listener(0) as listener:
        follower = live_run.Follower(native, live_run.params_of("euler", phone.PERIOD_US))
        sent = events[:600] + [data for data in events[600:800] if stops(data)]
        sender = Sender(listener.port, sent, lambda: intake.received.datagrams)
        sender.start()
        said = live_run.follow(listener, intake, follower, seconds=None, wait_s=20.0, stop=[], saw=lambda *_: None)
    assert sentence in said and follower.outcome.verdict == "pass"
    assert follower.outcome.steps == pytest.approx(298, abs=4)


def test_what_has_come_meanwhile_goes_to_the_board_together(native: StepBoard) -> None:
    """An adapter that holds every answer back for 16 ms must not make the phone's 100 samples a second wait in line."""
    turns: list[int] = []

    class Counting(Wrong):
        def stepper(self, params: ControlParams) -> Stepper:
            inner = native.stepper(params)

            class Stepping:
                def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput:
                    raise AssertionError

                def digests(self, raw: RawCounts) -> list[int]:
                    turns.append(len(raw))
                    return inner.digests(raw)

            return Stepping()

    with udp.Listener(0) as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for data in sensorstream(run_of())[:100]:
            out.sendto(data, ("127.0.0.1", listener.port))
        follower = live_run.Follower(Counting(native), live_run.params_of("euler", phone.PERIOD_US))
        intake = udp.Intake(phone.PERIOD_US)
        seen: list[int] = []
        live_run.follow(
            listener,
            intake,
            follower,
            seconds=0.9,
            wait_s=20.0,
            stop=[],
            saw=lambda _, words: seen.append(words["step"]),
        )
    assert turns == [90] and seen == list(range(1, 91)) and follower.outcome.verdict == "pass"


class BusyListener:
    """A listener on a clock of its own: what it gives, after how long. Then nothing comes any more."""

    address, port = "memory", 0

    def __init__(self, script: list[tuple[float, bytes]]) -> None:
        self.script, self.now_s = list(script), 0.0

    def receive_all(self, stop: list[int]) -> list[tuple[bytes, str]]:
        took_s, data = self.script.pop(0) if self.script else (udp.TURN_S, b"")
        self.now_s += took_s
        return [(data, "192.0.2.1")] if data else []


def test_a_host_that_was_busy_does_not_take_the_phone_for_silent(
    native: StepBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nine seconds before each of two datagrams, one of which completes no step: the host was away, not the phone."""
    events = sensagram(run_of())[:600]
    busy = [(9.0 if at % 100 > 97 else 0.0, data) for at, data in enumerate(events)]
    for silent_s, steps in ((0.0, 298), (live_run.SILENCE_S + 1.0, 148)):
        pause = [(udp.TURN_S, b"")] * round(silent_s / udp.TURN_S)
        listener = BusyListener([*busy[:300], *pause, *busy[300:]])
        monkeypatch.setattr(live_run, "time", SimpleNamespace(monotonic=lambda busy=listener: busy.now_s))
        intake = udp.Intake(phone.PERIOD_US)
        follower = live_run.Follower(native, live_run.params_of("euler", phone.PERIOD_US))
        said = live_run.follow(
            listener,  # type: ignore[arg-type]
            intake,
            follower,
            seconds=None,
            wait_s=20.0,
            stop=[],
            saw=lambda *_: None,
        )
        assert "the phone stopped sending" in said
        assert follower.outcome.steps == pytest.approx(steps, abs=4)


def test_a_taken_port_and_a_wrong_address_are_link_trouble(tmp_path: Path) -> None:
    with (
        udp.Listener(0) as first,
        pytest.raises(LinkError, match="Address already in use; choose another --udp"),
    ):
        udp.Listener(first.port)
    with pytest.raises(LinkError, match="--listen"):
        udp.Listener(0, "192.0.2.1")
    with pytest.raises(UsageError, match="--save"):
        udp.Saved(tmp_path / "no" / "file")


def test_loopback_unless_asked() -> None:
    with udp.Listener(0) as listener:
        assert listener.address == "127.0.0.1"
    with udp.Listener(0, udp.EVERYWHERE) as listener:
        assert listener.address == "0.0.0.0"
