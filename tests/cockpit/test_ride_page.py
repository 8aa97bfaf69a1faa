"""The page of a ride in a real browser: ridden by a scripted gamepad and by keys, and killed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from plumb import systems
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_server import PageServer
from plumb.cockpit.steering import transmitter
from plumb.cockpit.steering.trip_loop import TripLoop
from support.chromium import PATIENCE_S, Chromium, Page
from support.trip_bench import PAD, press, steering

RIDDEN = systems.with_part("ride")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not RIDDEN, reason="no declared system has ride.py")]
PATIENT_S = 5.0
"""Silence of these tests: a machine that is busy may leave a page waiting for longer than a rider's receiver does."""
HINT = "document.getElementById('hint').textContent"
SAID = "document.getElementById('said').textContent"
ARMED = "document.getElementById('armed').textContent === 'ARMED'"
ICE = "document.querySelector('[data-event=ice]').className"


@pytest.fixture
def loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TripLoop:
    monkeypatch.setattr(transmitter, "LOST_S", PATIENT_S)
    return TripLoop(RIDDEN[0], 1000, Hold(2 * PATIENT_S), folder=tmp_path)


@pytest.fixture
def server(loop: TripLoop) -> Iterator[PageServer]:
    with steering(loop) as server:
        yield server


def shown(label: str) -> str:
    """The number that the page shows below that label."""
    return f"Number(document.getElementById('{label}').textContent.replace('−', '-'))"


def key(page: Page, kind: str, code: str) -> None:
    page.call("Input.dispatchKeyEvent", type=kind, code=code, key=code)


def until(reached: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not reached():
        assert time.monotonic() < end_s, f"it never came to: {what}"
        time.sleep(0.005)


def test_a_gamepad_drives_turns_and_stays_up_on_ice_and_a_browser_that_is_killed_is_a_lost_receiver(
    server: PageServer, loop: TripLoop, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Chromium() as chromium:
        page = chromium.open(server.control_address)
        page.call("Emulation.setDeviceMetricsOverride", width=420, height=360, deviceScaleFactor=1, mobile=False)
        page.until(f"{HINT}.includes('Enter')")
        assert page.value("document.title") == "plumb ride"
        page.value(PAD)
        press(page, 0)
        page.until(f"{ARMED} && {HINT} === 'Hold W to drive'")
        page.value("pad.axes[1] = -0.4; pad.axes[2] = -0.4")
        page.until(f"{shown('speed')} > 0.2 && {shown('turn')} > 20 && {HINT} === ''")
        page.value("pad.axes[2] = 0")
        page.click("[data-event=ice]")
        page.until(f"{ICE} === 'on'")
        page.until(f"{ICE} === ''")
        assert page.value(f"{ARMED} && Math.abs({shown('tilt')}) < 20"), "it stays up"
        page.value("pad.axes[1] = 0")
        press(page, 1)
        page.until(f"{SAID}.includes('rider has left')")
        key(page, "keyDown", "KeyM")
        page.until(f"{SAID} === 'ridden'")
        key(page, "keyDown", "ArrowUp")
        page.until(f"{shown('speed')} > 0.2")
        monkeypatch.setattr(transmitter, "LOST_S", 0.1)
        chromium.kill()
        until(lambda: not loop.state["receiving"], "the receiver gets no signal")
        until(lambda: bool(loop.state["over"]), "the vehicle stands, and the ride is over")
    assert loop.trips == 1 and loop.state["said"] == "no receiver: it stands"
    until(lambda: bool(loop.reports), "a report")
