"""The page of a flight in a real browser: flown by a scripted gamepad, by keys, and left alone."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from plumb import systems
from plumb.__main__ import main
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_server import PageServer
from plumb.cockpit.steering import transmitter
from plumb.cockpit.steering.trip_loop import TripLoop
from plumb.cockpit.steering.trip_page import ASSETS
from plumb.readers import log_replay
from support.chromium import PATIENCE_S, Chromium, Page
from support.trip_bench import PAD, press, steering

STEERED = systems.with_part("fly")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not STEERED, reason="no declared system has fly.py")]
PATIENT_S = 5.0
"""Silence of these tests: a machine that is busy may leave a page waiting for longer than a pilot's receiver does."""
LOW_THROTTLE = 0.1
"""Of the receiver's range, while the rotors point down; the hover that the page holds is above 0.3."""
SLOWER, SLOW_FRAMES = 20, 30
"""A browser whose processor has this share of its time, and fewer pictures a second than this."""
HINT = "document.getElementById('hint').textContent"
READY = f"{HINT}.includes('Enter')"
ARMED = "document.getElementById('armed').textContent === 'ARMED'"
DISARMED = "document.getElementById('armed').textContent === 'disarmed'"
HEIGHT = "Number(document.getElementById('height').textContent)"
SAID = "document.getElementById('said').textContent"
LOST = "document.getElementById('receiver').textContent === 'receiver lost'"


@pytest.fixture
def loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TripLoop:
    monkeypatch.setattr(transmitter, "LOST_S", PATIENT_S)
    return TripLoop(STEERED[0], 1000, Hold(2 * PATIENT_S), folder=tmp_path)


@pytest.fixture
def server(loop: TripLoop) -> Iterator[PageServer]:
    with steering(loop) as server:
        yield server


@pytest.fixture
def chromium() -> Iterator[Chromium]:
    with Chromium() as chromium:
        yield chromium


def opened(chromium: Chromium, address: str) -> Page:
    """The page, small: what draws without a GPU leaves little time to the flight."""
    page = chromium.open(address)
    page.call("Emulation.setDeviceMetricsOverride", width=420, height=360, deviceScaleFactor=1, mobile=False)
    return page


def key(page: Page, kind: str, code: str) -> None:
    page.call("Input.dispatchKeyEvent", type=kind, code=code, key=code)


def upright(loop: TripLoop) -> float:
    """Cosine of the vehicle's lean: -1 on its back."""
    attitude = loop.scene["attitude"]
    assert isinstance(attitude, list)
    _, x, y, _ = attitude
    return float(1.0 - 2.0 * (x * x + y * y))


def height(loop: TripLoop) -> float:
    position = loop.scene["position"]
    assert isinstance(position, list)
    return float(position[2])


def until(reached: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not reached():
        assert time.monotonic() < end_s, f"it never came to: {what}"
        time.sleep(0.005)


def flip(page: Page, loop: TripLoop) -> float:
    """Mode rate, the full stick to the right until the vehicle is on its back, and mode level again; the least throttle
    while the rotors pointed down. How far it falls meanwhile is a matter of how fast the browser is."""
    heights, throttles = [height(loop)], [1.0]

    def turned(reached: bool) -> bool:
        heights.append(height(loop))
        if upright(loop) < 0.0:
            throttles.append(loop.transmitter.sticks.throttle)
        return reached

    press(page, 1)
    page.value("pad.axes[1] = -1; pad.axes[2] = 1")
    until(lambda: turned(upright(loop) < -0.5), "the vehicle on its back")
    page.value("pad.axes[2] = 0; pad.buttons[1].pressed = true")
    until(lambda: turned(upright(loop) > 0.95), "upright again")
    page.value("pad.buttons[1].pressed = false")
    began_to_rise = len(heights)
    until(lambda: turned(heights[-1] > min(heights[began_to_rise:] or heights[-1:]) + 0.1), "it climbs again")
    page.value("pad.axes[1] = 0")
    return min(throttles)


def frames_in_a_second(page: Page) -> int:
    drawn = page.value("""new Promise((done) => {
      let drawn = 0;
      const draw = () => { drawn++; requestAnimationFrame(draw); };
      requestAnimationFrame(draw);
      setTimeout(() => done(drawn), 1000);
    })""")
    assert isinstance(drawn, int)
    return drawn


def test_a_gamepad_takes_off_hovers_flips_and_lands_on_a_slow_browser_and_every_step_is_recorded(
    server: PageServer, loop: TripLoop, chromium: Chromium, tmp_path: Path
) -> None:
    page, viewer = opened(chromium, server.control_address), opened(chromium, server.watch_address)
    page.until(READY)
    page.value(PAD)
    press(page, 0)
    page.until(ARMED)
    viewer.until(f"{ARMED} && {HINT}.includes('watches')")
    viewer.close()
    page.value("pad.axes[1] = -1")
    page.until(f"{HEIGHT} > 1")
    page.value("pad.axes[1] = 0; pad.axes[0] = 1")
    page.until(f"{SAID} === 'flown' && document.getElementById('light').className === 'green'")
    assert page.value(HEIGHT) > 0.5  # type: ignore[operator]
    assert page.value("document.getElementById('flat').hidden"), "the scene is drawn"
    page.value("pad.axes[0] = 0; pad.axes[1] = -1")
    page.until(f"{HEIGHT} > 1.8")

    second = opened(chromium, server.control_address)
    second.until(f"{ARMED} && {HINT} === 'Another page steers; this one watches'")
    second.value(PAD)
    press(second, 0)
    assert second.value(ARMED), "a page that watches switches no rotors"
    second.close()

    assert flip(page, loop) <= LOW_THROTTLE, "the throttle is low while the rotors point down"
    assert loop.state["armed"] and loop.state["said"] == "flown"
    page.call("Emulation.setCPUThrottlingRate", rate=SLOWER)
    assert frames_in_a_second(page) < SLOW_FRAMES
    assert loop.state["receiving"] and upright(loop) > 0.95, "a slow picture flies on"
    page.call("Emulation.setCPUThrottlingRate", rate=1)
    page.value("pad.axes[1] = 1")
    page.until(f"{HEIGHT} < 0.2")
    press(page, 0)
    page.until(f"{HINT}.includes('over')")
    page.until("document.querySelector('#reports a') !== null")
    report = str(page.value("document.querySelector('#reports a').href"))
    assert "steered" not in report and page.value(f"fetch({json.dumps(report)}).then((answer) => answer.text())")
    assert loop.trips == 1 and loop.state["light"]["colour"] != "red"  # type: ignore[index]
    (log,) = tmp_path.glob("*.plog")
    (run,) = log_replay.runs_of(log_replay.open_log(log))
    assert run.run.steps > 4000 and run.known == run.run.steps and not run.run.incomplete, "no step is missing"
    assert main(["replay", str(log), "--board", "native"]) == 0


def test_keys_fly_and_the_buttons_let_it_happen(server: PageServer, chromium: Chromium) -> None:
    page = opened(chromium, server.control_address)
    page.until(READY)
    key(page, "keyDown", "Enter")
    page.until(ARMED)
    key(page, "keyDown", "KeyW")
    page.until(f"{HEIGHT} > 0.8")
    key(page, "keyUp", "KeyW")
    page.click("[data-event=lost]")
    page.until("document.getElementById('log').textContent.includes('the receiver gets no signal')")
    key(page, "keyDown", "Escape")
    page.until(DISARMED)


def test_hints_on_a_touch_screen_name_what_a_finger_reaches(server: PageServer, chromium: Chromium) -> None:
    page = opened(chromium, server.control_address)
    page.until(READY)
    page.call("Emulation.setDeviceMetricsOverride", width=390, height=700, deviceScaleFactor=1, mobile=True)
    page.call("Emulation.setTouchEmulationEnabled", enabled=True)
    page.until("document.getElementById('hint').textContent === 'Tap Rotors on'")
    assert page.value("getComputedStyle(document.getElementById('keys')).display") == "none"
    page.click("#motors-on")
    page.until("document.getElementById('hint').textContent === 'Move the left stick up'")


def in_the_air(page: Page) -> None:
    page.until(READY)
    key(page, "keyDown", "Enter")
    page.until(ARMED)
    key(page, "keyDown", "KeyW")
    page.until(f"{HEIGHT} > 0.8")
    key(page, "keyUp", "KeyW")


def test_a_browser_that_is_killed_is_a_lost_receiver(
    server: PageServer, loop: TripLoop, chromium: Chromium, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_the_air(opened(chromium, server.control_address))
    monkeypatch.setattr(transmitter, "LOST_S", 0.1)
    chromium.kill()
    with Chromium() as another:
        viewer = opened(another, server.watch_address)
        viewer.until(LOST)
        viewer.until(f"{HINT}.includes('over')")
        viewer.until("document.querySelector('#reports a') !== null")
    assert not loop.transmitter.receiving


def test_a_page_that_is_hidden_is_a_lost_receiver(
    server: PageServer, chromium: Chromium, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, viewer = opened(chromium, server.control_address), opened(chromium, server.watch_address)
    in_the_air(page)
    monkeypatch.setattr(transmitter, "LOST_S", 0.1)
    page.value("Object.defineProperty(document, 'hidden', { get: () => true, configurable: true }); 1")
    viewer.until(LOST)


def test_the_page_is_made_of_its_files_and_fetches_nothing() -> None:
    from plumb.cockpit import page_server

    folder = Path(page_server.__file__).parent / "page"
    assert all((folder / name).is_file() for name, _ in ASSETS.values())
    own = {path.name for path in (folder / "steering").iterdir()} - {"ogl.LICENSE"}
    assert own == {name.removeprefix("steering/") for name, _ in ASSETS.values() if name.startswith("steering/")}
    assert (folder / "steering" / "ogl.LICENSE").read_text(encoding="utf-8").startswith("OGL")
    for name in own - {"ogl.min.js"}:
        text = (folder / "steering" / name).read_text(encoding="utf-8")
        assert "http:" not in text and "https:" not in text and "//" not in text.replace("// ", "").replace("ws://", "")
