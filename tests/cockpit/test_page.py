"""The page in a real browser: what it shows, and what its end does to the board."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb.cockpit import page_server
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_server import PageServer
from support.chromium import Chromium, Page
from support.cockpit_bench import CockpitBench, serving

pytestmark = [pytest.mark.slow]
GREEN = "document.getElementById('light').className === 'green'"
ARMED = "document.getElementById('armed').textContent === 'ARMED'"
DISARMED = "document.getElementById('armed').textContent === 'disarmed'"
PIXELS = """(() => {
  const canvas = document.querySelector('.screen canvas');
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let blue = 0;
  for (let at = 0; at < data.length; at += 4) blue += data[at + 2] > data[at] + 60 && data[at + 3] > 128;
  return blue;
})()"""
"""Pixels of the first panel that have the colour of its first line."""


HOLD_S = 3.0
"""Of these tests: a machine that is busy may leave a page waiting for longer than the hold of a user allows."""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PageServer]:
    with serving(CockpitBench(tmp_path, hold=Hold(timeout_s=HOLD_S), paced=True).loop) as server:
        yield server


@pytest.fixture
def chromium() -> Iterator[Chromium]:
    with Chromium() as chromium:
        yield chromium


def arm(page: Page) -> None:
    page.until("!document.querySelector('#health').textContent.includes('not ready')")
    page.click("[data-do=arm]")
    page.until(ARMED)


def test_a_page_shows_the_board_and_two_viewers_see_it_stop(server: PageServer, chromium: Chromium) -> None:
    page, viewer = chromium.open(server.control_address), chromium.open(server.watch_address)
    page.until(GREEN)
    viewer.until(GREEN)
    assert viewer.value("[...document.querySelectorAll('[data-do]')].every((button) => button.disabled)")
    page.value("document.querySelector('.screen').scrollIntoView()")  # what is not on the screen is not drawn
    page.until(f"{PIXELS} > 20")
    page.until("document.getElementById('angles').textContent.includes('roll')")
    arm(page)
    viewer.until(ARMED)
    viewer.press("Escape")
    page.until(DISARMED)
    page.until("document.getElementById('log').textContent.includes('a page asked for a stop')")
    page.value("document.querySelector('[data-act=pause]').focus()")
    arm(page)
    page.press(" ")
    page.until(DISARMED)
    assert page.value("document.querySelector('[data-act=pause]').getAttribute('aria-pressed')") == "false"


def test_a_browser_that_is_killed_while_armed_disarms(server: PageServer, chromium: Chromium) -> None:
    page = chromium.open(server.control_address)
    arm(page)
    chromium.kill()
    with Chromium() as another:
        viewer = another.open(server.watch_address)
        viewer.until(DISARMED)
        viewer.until("document.getElementById('log').textContent.includes('the page that armed fell silent')")


def test_a_page_that_hangs_while_armed_disarms(server: PageServer, chromium: Chromium) -> None:
    page, viewer = chromium.open(server.control_address), chromium.open(server.watch_address)
    arm(page)
    viewer.until(ARMED)
    page.value("setTimeout(() => { const end = Date.now() + 20000; while (Date.now() < end); }, 0); 1")
    viewer.until(DISARMED)
    viewer.until("document.getElementById('log').textContent.includes('the page that armed fell silent')")


def write(page: Page, name: str, value: str, *, taken: bool = True) -> None:
    """Open the row of a parameter, and set it by its field."""
    row = f"document.querySelector('[data-name=\"{name}\"]')"
    page.until(f"{row} !== null")
    page.value(f"{row}.childElementCount > 1 || {row}.querySelector('button').click()")
    page.until(f"{row}.querySelector('input[type=range]') !== null")
    page.value(
        f"{row}.querySelector('input[type=number]').value = '{value}'; {row}.querySelector('.row button').click()"
    )
    if taken:
        page.until(f"{row}.querySelector('output').textContent === '{value}'")


def test_parameters_are_set_and_a_recording_is_made_from_the_page(
    server: PageServer, chromium: Chromium, tmp_path: Path
) -> None:
    page = chromium.open(server.control_address)
    page.until(GREEN)
    page.click("[data-do=parameters]")
    page.until("document.querySelectorAll('.parameter').length > 20")
    write(page, "kalman.q_angle_deg2_per_s", "0.004")
    page.until("document.getElementById('log').textContent.includes('run 2 of quad began')")
    page.until(GREEN)
    page.until("document.querySelector('[data-name=\"pid.kp_per_deg\"] .live') !== null")
    write(page, "pid.kp_per_deg", "0.05")
    page.until(GREEN)
    assert "run 3" not in page.text
    write(page, "pid.kp_per_deg", "1e6", taken=False)
    page.until("document.getElementById('answer').className === 'bad'")
    page.click("[data-do=record]")
    page.until("document.querySelector('[data-do=record]').textContent.match(/recording .[1-9]/)")
    page.click("[data-do=record]")
    page.until("document.getElementById('log').textContent.includes('recorded')")
    assert list(tmp_path.glob("*.plog"))
    arm(page)
    locked = "document.querySelector('[data-name=\"kalman.q_angle_deg2_per_s\"] input').disabled"
    page.until(locked)
    gain = "document.querySelector('[data-name=\"pid.kp_per_deg\"] input[type=range]')"
    page.until(f"Math.abs({gain}.max / {gain}.min - 4) < 0.01")
    write(page, "pid.kp_per_deg", "0.04")
    page.until(f"{gain}.max > 0.079")
    assert page.value(ARMED) and page.value(GREEN)
    page.press("Escape")
    page.until(f"{DISARMED} && !{locked}")


def test_nothing_can_be_pressed_before_the_board_is_known() -> None:
    html = (Path(page_server.__file__).parent / "page" / "index.html").read_text(encoding="utf-8")
    buttons = re.findall(r"<button[^>]*data-do=[^>]*>", html)
    assert len(buttons) > 5 and all(" disabled>" in button for button in buttons)


def test_a_server_that_ends_leaves_a_page_that_says_so(tmp_path: Path, chromium: Chromium) -> None:
    with serving(CockpitBench(tmp_path, hold=Hold(timeout_s=HOLD_S), paced=True).loop) as server:
        page = chromium.open(server.control_address)
        page.until(GREEN)
    page.until("document.getElementById('light-text').textContent === 'no connection'")
    assert page.value("document.getElementById('armed').textContent") == "unknown"
    assert page.value("document.querySelector('aside').inert && !document.getElementById('trouble').hidden")


def test_a_page_that_is_hidden_gives_no_heartbeat(server: PageServer, chromium: Chromium) -> None:
    page, viewer = chromium.open(server.control_address), chromium.open(server.watch_address)
    arm(page)
    page.value("Object.defineProperty(document, 'hidden', { get: () => true }); 1")
    viewer.until("document.getElementById('log').textContent.includes('the page that armed fell silent')")
    viewer.until(DISARMED)
