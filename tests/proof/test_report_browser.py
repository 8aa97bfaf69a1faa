"""The report page in a browser: zoom, pan, cursor and hidden lines act on all plots."""

from __future__ import annotations

import itertools
import json
import re
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest

from plumb.proof import report, xy_plot

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
TIME_S = np.arange(5000) / 100.0
ACTS = """
const svgs = [...document.querySelectorAll("section.plot svg")], said = [];
const frame = () => new Promise(done => setTimeout(done, 100));
const at = (svg, x, y) => { const box = svg.getBoundingClientRect();
  return { clientX: box.left + x / 1056 * box.width, clientY: box.top + y / 250 * box.height, bubbles: true }; };
const send = (svg, kind, x, y, more = {}) => svg.dispatchEvent(new PointerEvent(kind, { ...at(svg, x, y), ...more }));
const note = async what => { await frame(); said.push({ what, low: +document.body.dataset.low,
  high: +document.body.dataset.high, last: svgs.map(svg => [...svg.querySelectorAll(".ticks .t")].at(-1).textContent),
  cursors: svgs.map(svg => svg.querySelector(".cursor").getAttribute("d")),
  keys: [...document.querySelectorAll(".key output")].map(output => output.textContent),
  drawn: [...svgs[0].querySelectorAll(".lines path")].map(path => path.getAttribute("d").length > 0),
  scrolls: [...document.querySelectorAll(".frame")].map(frame => frame.scrollWidth > frame.clientWidth),
  labels: [...document.querySelectorAll(".ticks .t:not([visibility=hidden])")].map(label => {
    const text = label.getBoundingClientRect(), svg = label.closest("svg").getBoundingClientRect();
    return { size: text.height, left: text.left - svg.left, right: text.right - svg.left, width: svg.width }; }),
  values: [...svgs[0].querySelectorAll(".ticks .v")].map(text => +text.textContent) }); };
(async () => {
  await note("whole");
  send(svgs[0], "pointerdown", 76 + 968 * 0.2, 60); send(svgs[0], "pointermove", 76 + 968 * 0.4, 60);
  send(svgs[0], "pointerup", 76 + 968 * 0.4, 60);
  await note("zoomed");
  send(svgs[1], "pointerdown", 560, 60, { shiftKey: true });
  send(svgs[1], "pointermove", 560 - 968 / 2, 60, { shiftKey: true });
  send(svgs[1], "pointerup", 560 - 968 / 2, 60, { shiftKey: true });
  await note("panned");
  send(svgs[1], "pointermove", 76 + 968 / 2, 60);
  await note("cursor");
  send(svgs[1], "pointerleave", 0, 0);
  document.querySelector(".key").click();
  await note("hidden");
  document.querySelector(".key").click();
  svgs[0].dispatchEvent(new KeyboardEvent("keydown", { key: "0" }));
  await note("keyed");
  document.querySelector("[data-act=in]").click();
  await note("button");
  svgs[1].dispatchEvent(new MouseEvent("dblclick"));
  send(svgs[0], "pointerdown", 500, 40); send(svgs[0], "pointermove", 502, 90); send(svgs[0], "pointerup", 502, 90);
  await note("tall");
  document.body.style.width = "358px"; // a phone of 390 px, less the page's padding
  dispatchEvent(new Event("resize")); // a page that is not shown sends none
  await note("narrow");
  const result = document.createElement("pre"); result.id = "said"; result.textContent = JSON.stringify(said);
  document.body.append(result);
})();
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the page shows after each act, by name."""
    if BROWSER is None:
        pytest.skip("no browser to show a page with")
    folder = tmp_path_factory.mktemp("browser")
    sine = report.Line("sine", np.sin(TIME_S), report.ESTIMATE, band=np.full(len(TIME_S), 0.25))
    plots = [
        report.Plot("Tilt", "deg", TIME_S, [sine, report.Line("ramp", TIME_S / 50.0, report.SECOND)]),
        report.Plot("Rate", "deg/s", TIME_S, [report.Line("gyro", TIME_S, report.SENSOR)]),
    ]
    decades = np.logspace(-2.0, 1.0, 40)
    curve = xy_plot.Curve("gain", decades, decades, report.ESTIMATE, points=True)
    bode = xy_plot.XyPlot("Gain", xy_plot.Axis("Hz", log=True), xy_plot.Axis("dB"), [curve])
    page = report.page("A run", "pass", "", [*plots, bode])
    page = re.sub(r"<meta http-equiv[^>]*>", "", page).replace("</body>", f"<script>{ACTS}</script></body>")
    (folder / "page.html").write_text(page, encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command += ["--window-size=1200,900", "--virtual-time-budget=10000", "--dump-dom", (folder / "page.html").as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=200.0, check=True).stdout
    found = re.search(r'<pre id="said">(.*?)</pre>', shown)
    assert found is not None, shown[-2000:]
    return {state["what"]: state for state in json.loads(found[1])}


def test_the_whole_run_is_shown_first(said: dict[str, Any]) -> None:
    assert (said["whole"]["low"], said["whole"]["high"]) == (0.0, 49.99)


def test_a_drag_zooms_all_plots(said: dict[str, Any]) -> None:
    assert said["zoomed"]["low"] == pytest.approx(10.0, abs=0.1)
    assert said["zoomed"]["high"] == pytest.approx(20.0, abs=0.1)
    assert said["whole"]["last"] == ["45", "45"] and said["zoomed"]["last"] in (["19", "19"], ["20", "20"])


def test_a_drag_with_shift_pans(said: dict[str, Any]) -> None:
    assert said["panned"]["low"] == pytest.approx(15.0, abs=0.1)
    assert said["panned"]["high"] == pytest.approx(25.0, abs=0.1)


def test_the_cursor_stands_in_all_plots_and_shows_values(said: dict[str, Any]) -> None:
    state = said["cursor"]
    assert state["cursors"][0] == state["cursors"][1] != ""
    sine, ramp, gyro = (text.split(" ± ") for text in state["keys"])
    assert float(gyro[0]) == pytest.approx(20.0, abs=0.1) and sine[1] == "0.250"
    assert float(sine[0]) == pytest.approx(np.sin(float(gyro[0])), abs=1e-4)
    assert float(ramp[0]) == pytest.approx(float(gyro[0]) / 50.0, abs=1e-5)
    assert said["hidden"]["cursors"] == ["", ""]


def test_a_name_hides_its_line_and_band(said: dict[str, Any]) -> None:
    assert said["hidden"]["drawn"] == [False, False, True] and said["keyed"]["drawn"] == [True, True, True]


def test_keys_and_buttons_change_the_view(said: dict[str, Any]) -> None:
    assert (said["keyed"]["low"], said["keyed"]["high"]) == (0.0, 49.99)
    assert said["button"]["high"] - said["button"]["low"] == pytest.approx(49.99 / 2)


def test_a_drag_down_zooms_the_values_of_one_plot(said: dict[str, Any]) -> None:
    whole, tall = said["whole"]["values"], said["tall"]["values"]
    assert max(tall) - min(tall) < 0.5 * (max(whole) - min(whole))
    assert (said["tall"]["low"], said["tall"]["high"]) == (0.0, 49.99)


def test_a_narrow_screen_shows_whole_plots_with_labels_that_can_be_read(said: dict[str, Any]) -> None:
    wide, narrow = said["whole"], said["narrow"]
    assert narrow["scrolls"] == [False, False, False] and narrow["last"] == ["40", "40"]
    assert all(label["width"] == 358.0 for label in narrow["labels"])
    for label, after in itertools.pairwise(narrow["labels"]):
        assert 0.0 < label["left"] < label["right"] <= 358.0
        assert label["right"] < after["left"] or after["left"] < label["left"], "labels of one axis are apart"
    assert {label["size"] for label in narrow["labels"]} == {label["size"] for label in wide["labels"]}
