"""Whatever stops an armed board during a step test ends its setpoint on the board, and the page shows that: the hand on
the page, its end, another page, the board itself, its arm switch, a link that is lost. In a real browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from plumb.cockpit import board_loop
from plumb.cockpit.hold import Hold
from support.chromium import Chromium, Page
from support.cockpit_bench import CockpitBench, serving

pytestmark = [pytest.mark.slow]
HOLD_S = 3.0
"""As in the other tests of the page: a machine that is busy may leave a page waiting for longer than a user's hold."""
SHOWN = "document.getElementById('setpoint-shown').textContent"
SLIDER = "document.getElementById('setpoint-value')"
NEUTRAL = f"{SHOWN} === '0.00 deg'"
AT_NEUTRAL = f"{NEUTRAL} && {SLIDER}.value === '0'"
ARMED = "document.getElementById('armed').textContent === 'ARMED'"
DISARMED = "document.getElementById('armed').textContent === 'disarmed'"
LIMIT = 1 << 3
"""A fault of the board's wires that disarms."""


@dataclass
class Desk:
    """A board with a page that controls it and one that watches."""

    chromium: Chromium
    bench: CockpitBench
    control_address: str
    page: Page
    viewer: Page

    def arm(self) -> None:
        self.page.until("!document.querySelector('#health').textContent.includes('not ready')")
        self.page.click("[data-do=arm]")
        self.page.until(ARMED)

    def test(self, seconds: float = 20.0) -> None:
        """Begin a step test of 5 deg."""
        for name, value in (("size", 5.0), ("seconds", seconds)):
            self.page.value(f"document.getElementById('step-{name}').value = '{value}'")
        self.page.click("[data-do=step_test]")
        self.viewer.until(f"{SHOWN} === '5.00 deg'")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Chromium]:
    with Chromium() as chromium:
        yield chromium


@pytest.fixture
def desk(tmp_path: Path, chromium: Chromium, monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    monkeypatch.setattr(board_loop, "REOPEN_S", 0.1)
    bench = CockpitBench(tmp_path, hold=Hold(timeout_s=HOLD_S), paced=True)
    with serving(bench.loop) as server:
        pages = [chromium.open(address) for address in (server.control_address, server.watch_address)]
        yield Desk(chromium, bench, server.control_address, *pages)
        for page in pages:
            page.close()


def hidden(desk: Desk) -> None:
    desk.page.value("Object.defineProperty(document, 'hidden', { get: () => true, configurable: true }); 1")


def seen(desk: Desk) -> None:
    desk.page.value("delete document.hidden; 1")


def another_page(desk: Desk) -> None:
    """It cannot take over; its order of a setpoint is refused; its stop is heeded."""
    second = desk.chromium.open(desk.control_address)
    second.until("document.getElementById('role').textContent.includes('Another page holds')")
    assert second.value(f"{SLIDER}.disabled && document.querySelector('[data-do=take]').disabled")
    second.press("Escape")
    second.until(AT_NEUTRAL)
    second.close()


def fault(desk: Desk) -> None:
    desk.bench.board.mcu.wires.faults = LIMIT


def link_lost(desk: Desk) -> None:
    desk.bench.board.mcu.power_off()
    desk.viewer.until("document.getElementById('log').textContent.includes('the board answers again')")


WAYS: dict[str, tuple[Callable[[Desk], object], Callable[[Desk], object]]] = {
    "Space": (lambda desk: desk.page.press(" "), lambda _: None),
    "Esc": (lambda desk: desk.page.press("Escape"), lambda _: None),
    "button": (lambda desk: desk.page.click("#stop"), lambda _: None),
    "viewer": (lambda desk: desk.viewer.press(" "), lambda _: None),
    "another page": (another_page, lambda _: None),
    "page hidden": (hidden, seen),
    "page given up": (
        lambda desk: desk.page.click("[data-do=release]"),
        lambda desk: desk.page.click("[data-do=take]"),
    ),
    "page loaded anew": (lambda desk: desk.page.call("Page.reload"), lambda desk: desk.page.load()),
    "board": (fault, lambda desk: setattr(desk.bench.board.mcu.wires, "faults", 0)),
    "link lost": (link_lost, lambda _: None),
}
"""Way -> what ends the arming, and what has to be done before the next one."""


@pytest.mark.parametrize("way", WAYS)
def test_what_stops_a_step_test_ends_its_setpoint_on_the_board_and_on_the_pages(way: str, desk: Desk) -> None:
    stop, mend = WAYS[way]
    desk.arm()
    desk.test()
    stop(desk)
    desk.viewer.until(f"{DISARMED} && {AT_NEUTRAL}")
    mend(desk)
    desk.page.until(f"{DISARMED} && {AT_NEUTRAL} && document.getElementById('setpoint-value').disabled")
    desk.arm()
    time.sleep(0.5)
    assert desk.page.value(f"{ARMED} && {AT_NEUTRAL}"), "no setpoint comes back with the next arming"
    assert desk.bench.loop.state["test"] is None


def test_a_page_that_is_closed_during_a_step_test_ends_its_setpoint(desk: Desk) -> None:
    desk.arm()
    desk.test()
    desk.page.close()
    desk.viewer.until(f"{DISARMED} && {AT_NEUTRAL}")


def test_the_slider_follows_the_board_at_the_end_of_a_step_test(desk: Desk) -> None:
    """It had stayed where the test had brought it, while the board was at 0."""
    desk.arm()
    desk.test(1.0)
    desk.page.until("document.getElementById('log').textContent.includes('step test of 5 deg')")
    desk.page.until(f"{ARMED} && {AT_NEUTRAL}")
    desk.page.value(f"{SLIDER}.value = '3'; {SLIDER}.dispatchEvent(new Event('input'))")
    desk.viewer.until(f"{SHOWN} === '3.00 deg'")
    assert desk.page.value(f"{ARMED} && {SLIDER}.value === '3'")


def test_the_arm_switch_takes_no_setpoint_over(desk: Desk) -> None:
    """The setpoint of the page's arming is none of the switch's, and the page gives it none."""
    wires = desk.bench.board.mcu.wires
    wires.arm_switch = 0
    time.sleep(0.2)
    desk.arm()
    desk.test()
    desk.page.press(" ")
    desk.viewer.until(f"{DISARMED} && {AT_NEUTRAL}")
    wires.arm_switch = 1
    desk.page.until("document.getElementById('armed').textContent === 'ARMED elsewhere'")
    assert desk.page.value(f"{AT_NEUTRAL} && {SLIDER}.disabled")
    wires.arm_switch = 0
    desk.viewer.until(f"{DISARMED} && {AT_NEUTRAL}")
