"""The plots of the page, drawn in a browser: what they cost, and that nothing is missing in them."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from plumb.cockpit.page_server import PageServer
from support.chromium import Chromium, Page
from support.cockpit_bench import CockpitBench

pytestmark = [pytest.mark.slow]
BENCH = Path(__file__).resolve().parents[1] / "support" / "plot_bench.js"
WHOLE_S, SHORT_S = 30, 1
FULL_ROWS = 32 * 500
FRAMES, BATCHES = 40, 3
EDGE = 64
"""Most that a pixel at the edge of a line differs when the line is drawn elsewhere; a line itself differs by 200."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A document of the server with the bench of plot_bench.js in it."""
    bench = CockpitBench(tmp_path_factory.mktemp("plots"))
    with PageServer(bench.loop) as server, Chromium() as chromium:
        page = chromium.open(f"{server.watch_address}rows.js")
        assert page.value(BENCH.read_text(encoding="utf-8")) is True
        yield page
    bench.close()


def begin(page: Page, rate: int, span_s: float, rows: int = FULL_ROWS) -> None:
    """Plots of so many seconds at a rate, whose window is full."""
    page.value(f"bench = new Bench({rate}); bench.view.span = {span_s}; bench.feed({rows}); bench.draw()")


def difference(page: Page, before: str) -> float:
    """The greatest difference of a channel of a pixel between the pictures and those before."""
    found = page.value(f"bench.difference({before})")
    assert isinstance(found, int | float)
    return found


def points(page: Page) -> float:
    """Points drawn in a frame, of the eight signals together."""
    drawn = page.value(f"Array.from({{ length: {FRAMES} }}, () => bench.frame())")
    assert isinstance(drawn, list)
    return float(statistics.median(drawn))


def processor_s(page: Page, frames: int) -> float:
    """Time of the page's main thread for so many frames, their raster included, as its processor counts it."""

    def now() -> float:
        said = page.call("Performance.getMetrics")["metrics"]
        assert isinstance(said, list)
        return next(float(one["value"]) for one in said if one["name"] == "TaskDuration")

    page.call("Performance.enable", timeDomain="threadTicks")
    before = now()
    page.value(f"bench.frames({frames})")
    return now() - before


def test_a_frame_draws_what_is_new_and_no_more(page: Page) -> None:
    """A whole picture of 30 s has some 15,000 points."""
    begin(page, 500, WHOLE_S)
    assert points(page) < 150
    begin(page, 500, SHORT_S)
    assert points(page) < 300
    whole = page.value("bench.plots.forEach(({ panel }) => { panel.whole = true; }); bench.frame()")
    assert isinstance(whole, int) and whole > 3000


def test_the_points_of_a_frame_do_not_grow_with_the_rate(page: Page) -> None:
    begin(page, 50, WHOLE_S, 32 * 50)
    slow = points(page)
    begin(page, 500, WHOLE_S)
    assert points(page) < 1.5 * slow


def test_a_frame_of_30_s_costs_no_more_than_one_of_1_s(
    page: Page, record_property: Callable[[str, object], None]
) -> None:
    """Processor time within one run of this machine, the least of some batches each."""
    cost: dict[float, list[float]] = {WHOLE_S: [], SHORT_S: []}
    for _ in range(BATCHES):
        for span_s, found in cost.items():
            begin(page, 500, span_s)
            page.value("bench.frames(2)")
            found.append(processor_s(page, FRAMES) / FRAMES)
    whole, short = min(cost[WHOLE_S]), min(cost[SHORT_S])
    record_property("ms_of_a_frame", round(1e3 * whole, 2))
    print(f"a frame of eight signals at 500 Hz: {1e3 * whole:.2f} ms for 30 s, {1e3 * short:.2f} ms for 1 s")
    assert whole < 1.5 * short


@pytest.mark.parametrize(("rate", "span_s"), [(500, 30), (500, 1), (50, 30), (100, 4.1), (500, 0.05)])
def test_a_picture_that_moved_equals_one_that_is_drawn_anew(page: Page, rate: int, span_s: float) -> None:
    begin(page, rate, span_s)
    page.value("for (let frame = 0; frame < 200; frame++) bench.frame()")
    page.value("moved = bench.pictures; bench.plots.forEach(({ panel }) => { panel.whole = true; }); bench.draw()")
    assert difference(page, "moved") <= EDGE
    page.value("bench.frame(); bench.frame()")
    assert difference(page, "moved") > EDGE


def test_a_spike_of_one_sample_is_in_the_picture(page: Page) -> None:
    begin(page, 500, WHOLE_S)
    assert page.value("bench.spread(1)[1] < 50")
    page.value("const feed = bench.rows.values[3]; feed[(bench.rows.count - 7) & (feed.length - 1)] = 99; 1")
    page.value("bench.plots[1].panel.renew(bench.plots[1].panel.scale); bench.draw()")
    assert page.value("bench.spread(1)[1]") == 99
    assert page.value("bench.plots[1].panel.range.top > 99")


def test_a_view_of_the_past_is_not_drawn_again(page: Page) -> None:
    begin(page, 500, WHOLE_S)
    page.value("bench.view.pause(); bench.draw(); still = bench.pictures")
    drawn = page.value(f"Array.from({{ length: {FRAMES} }}, () => bench.frame())")
    assert drawn == [0] * FRAMES and difference(page, "still") == 0


def test_a_new_run_begins_the_plots_anew(page: Page) -> None:
    begin(page, 500, WHOLE_S)
    page.value("bench.rows.reset(2, 8); bench.at = 0; bench.draw(); 1")
    assert page.value("bench.rows.count === 0 && bench.plots[0].panel.end === 0")


def test_what_does_not_move_is_a_flat_line_and_motors_say_that_they_are_not_driven(page: Page) -> None:
    page.value("bench = new Bench(100); 0")
    scales = page.value("""import("./scale.js").then(({ rangeFor }) => {
      const flat = rangeFor(1000, 1000, null, 10), noisy = rangeFor(-0.4, 0.4, null, 0.1);
      return [flat.bottom, flat.top, noisy.bottom, noisy.top];
    })""")
    assert isinstance(scales, list)
    flat_bottom, flat_top, noisy_bottom, noisy_top = scales
    assert flat_bottom <= 995 and flat_top >= 1005 and -0.6 < noisy_bottom <= -0.4 and 0.4 <= noisy_top < 0.6
    found = page.value("""import("./plots.js").then(({ plotsOf }) => {
      const columns = [["left", "", true], ["tilt_deg", "deg", false], ["right", "", true], ["phase", "", false]];
      const plots = plotsOf(columns.map(([name, unit, drives]) => ({ name, unit, drives })), bench.rows, bench.view);
      return plots.map((plot) => {
        plot.showArmed(false);
        const disarmed = plot.element.contains(plot.idle) && !plot.idle.hidden;
        plot.showArmed(true);
        return [plot.title, plot.signals.length, disarmed, plot.idle.hidden];
      });
    })""")
    assert found == [["deg", 1, False, True], ["motors", 2, True, True], ["phase", 1, False, True]]
