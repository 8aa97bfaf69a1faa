"""The report page is one file that stands alone, and no plot hides a spike."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.judging.quad import plots as quad_plots
from plumb.proof import report, runs, svg_plot
from plumb.systems.quad.scenarios import TUNINGS
from plumb.systems.quad.scenarios import scenario as quad_scenario

TIME_S = np.arange(50_000) / 1000.0


def test_a_single_spike_survives_thinning() -> None:
    values = np.zeros_like(TIME_S)
    values[31_415] = 7.0
    at = svg_plot.kept(values, 2000)
    assert len(at) <= 2000 and 31_415 in at


def test_thinned_points_stay_in_order_of_time() -> None:
    assert np.all(np.diff(svg_plot.kept(np.sin(TIME_S * 40.0), 2000)) > 0)


def test_a_stretch_without_values_is_a_gap_not_an_error() -> None:
    values = np.where(TIME_S < 25.0, np.nan, 1.0)
    kept = values[svg_plot.kept(values, 2000)]
    assert np.isnan(kept[0]) and kept[-1] == 1.0
    assert svg_plot.path(np.arange(4.0), np.array([1.0, np.nan, 2.0, 3.0])) == "M0.0,1.0M2.0,2.0L3.0,3.0"


HOSTILE = '</script><img src=x onerror="1">&'


def a_page() -> str:
    band = np.full(len(TIME_S), 0.1)
    plot = report.Plot(
        "true <tilt>", "deg", TIME_S, [report.Line("tilt " + HOSTILE, np.sin(TIME_S), report.ESTIMATE, band=band)]
    )
    other = report.Plot("Rate", "deg/s", TIME_S[:100], [report.Line("gyro", 1e3 * TIME_S[:100], report.SENSOR)])
    table = report.Table("Errors", ["who", "rms"], [["a & b", HOSTILE], ["c", "2"]], bad_rows=frozenset({1}))
    claim = report.Statement("accuracy", "93 deg rms " + HOSTILE, None)
    return report.page("A run " + HOSTILE, "pass", "All is well." + HOSTILE, [plot, table, other], [claim])


@pytest.fixture(scope="module")
def page() -> str:
    return a_page()


class Elements(HTMLParser):
    """Every element of a page with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def of(self, name: str) -> list[dict[str, str | None]]:
        return [attributes for tag, attributes in self.found if tag == name]


def test_the_page_loads_nothing_from_elsewhere(page: str) -> None:
    elements = Elements(page)
    assert not [row for _, row in elements.found if row.keys() & {"src", "href", "srcset", "onload", "onerror"}]
    assert "@import" not in page and not re.search(r"url\((?!#)", page)
    policy = next(row["content"] for row in elements.of("meta") if row.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None and policy.startswith("default-src 'none';")


def test_the_browser_may_run_the_pages_own_script_alone(page: str) -> None:
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert len(scripts) == 1 and f"script-src 'sha256-{digest}'\"" in page


def test_text_is_escaped_and_bad_rows_are_marked(page: str) -> None:
    assert "a &amp; b" in page and "true &lt;tilt&gt;" in page
    assert page.count('<tr class="bad">') == 1
    assert not Elements(page).of("img")
    with pytest.raises(ValueError, match="rrggbb"):
        svg_plot.stroke('red" onload="1')


def test_a_table_of_many_columns_keeps_its_words_whole() -> None:
    tables = [report.Table(name, ["column"] * count, [["cell"] * count]) for name, count in (("two", 2), ("six", 6))]
    text = report.page("Tables", "", "", tables)
    assert text.count('<div class="wide many">') == text.count('<div class="wide">') == 1
    assert ".many td { overflow-wrap: normal; }" in text


def test_drawings_stand_before_tables_in_their_order() -> None:
    time_s = np.arange(3.0)
    plots = [report.Plot(name, "deg", time_s, [report.Line(name, time_s, report.TRUTH)]) for name in ("one", "two")]
    tables = [report.Table(name, ["column"], [["cell"]]) for name in ("Figures", "Identity")]
    text = report.page("Order", "", "", [tables[0], plots[0], tables[1], plots[1]])
    assert re.findall("<h2>(.*?)</h2>", text) == ["one", "two", "Figures", "Identity"]


def test_the_page_is_the_same_every_time(page: str) -> None:
    assert a_page() == page


def test_every_plot_is_described_in_words(page: str) -> None:
    drawn = Elements(page).of("svg")
    assert len(drawn) == 2 and all(row["role"] == "img" for row in drawn)
    words = str(drawn[1]["aria-label"])
    assert words == "Rate, 0 s to 0.099 s. gyro, from 0 to 99 deg/s."
    assert "with a band" in str(drawn[0]["aria-label"])


def test_all_plots_begin_and_end_at_the_same_place(page: str) -> None:
    ends = {(row["x"], row["width"]) for row in Elements(page).of("rect")}
    assert ends == {(str(svg_plot.LEFT), str(svg_plot.COLUMNS))}


def test_the_page_contains_the_samples(page: str) -> None:
    data = json.loads(re.findall(r'id="plot-data">(.*?)</script>', page)[0])
    line = data[1]["lines"][0]
    values = np.frombuffer(base64.b64decode(line["values"]), "<f4")
    assert line["time"] == [0.0, 0.001] and np.array_equal(values, (1e3 * TIME_S[:100]).astype("<f4"))
    long = data[0]["lines"][0]
    assert len(base64.b64decode(long["values"])) == 4 * 25_000
    assert "Drawn of 50000 samples: the least and the greatest of each 4 in a row." in page
    assert len(base64.b64decode(long["band"])) == len(base64.b64decode(long["time"])) == 4 * 25_000


def test_a_minute_at_500_hz_is_a_page_of_a_few_megabytes() -> None:
    """As many lines as the system with the most has."""
    time_s, noise = np.arange(30_000) / 500.0, np.random.default_rng(1)
    lines = [report.Line(str(i), noise.normal(size=30_000), report.SECOND) for i in range(22)]
    plots = [report.Plot(f"{i}", "deg", time_s, lines[i : i + 3]) for i in range(0, 22, 3)]
    assert 3e6 < len(report.page("Long", "pass", "", plots)) < 6e6


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (-1.0, 1.0, ["-1.0", "-0.5", "0", "0.5", "1.0"]),
        (0.0, 60.0, ["0", "20", "40", "60"]),
        (-2.1e-5, 2.3e-5, ["-2e-5", "-1e-5", "0", "1e-5", "2e-5"]),
        (1499.7, 1500.3, ["1499.8", "1500.0", "1500.2"]),
        (0.0, 3e6, ["0", "1e6", "2e6", "3e6"]),
    ],
)
def test_ticks_are_round_numbers(low: float, high: float, said: list[str]) -> None:
    found = svg_plot.ticks(low, high, 5)
    assert [svg_plot.tick_text(tick, found[1] - found[0]) for tick in found] == said


@pytest.mark.parametrize("values", [np.full(5, 3.0), np.zeros(5), np.full(5, np.nan), np.empty(0)])
def test_a_line_without_extent_still_has_axes(values: npt.NDArray[np.float64]) -> None:
    plot = report.Plot("flat", "deg", np.arange(len(values)) / 10.0, [report.Line("one", values, report.TRUTH)])
    assert "nan" not in svg_plot.panel(plot, "0") and "<svg" in report.page("flat", "", "", [plot])


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UsageError, match=r"cannot write .*--out"):
        report.write_whole(tmp_path / "file", {"report.html": "text"})


@pytest.mark.parametrize("trouble", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_files_appear_together_or_not_at_all(
    trouble: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report.write_whole(tmp_path, {"a": "old", "b": "old"})
    write = Path.write_bytes

    def failing(path: Path, data: bytes) -> int:
        if path.name.startswith("b"):
            raise trouble
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", failing)
    with pytest.raises((UsageError, KeyboardInterrupt)):
        report.write_whole(tmp_path, {"a": "new", "b": "new"})
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": "old", "b": "old"}


def test_a_plot_can_be_read_on_a_narrow_screen(page: str) -> None:
    assert page.count('<div class="frame"><svg') == 2 and ".frame { overflow-x: auto; }" in page


def test_a_note_of_several_plots_stands_once() -> None:
    time_s, line = TIME_S[:100], report.Line("tilt", TIME_S[:100], report.ESTIMATE)
    plots = [report.Plot(f"plot {i}", "deg", time_s, [line], note) for i, note in enumerate(("same", "same", "own"))]
    text = report.page("A run", "", "", plots)
    assert re.findall(r'<p class="note">(same|own)</p>', text) == ["same", "own"]


def test_a_closed_loop_shows_what_was_asked_for() -> None:
    params, scenario = quantise(TUNINGS["hold"]), quad_scenario("hold", 1000, seconds=2.0)
    flown = runs.closed_loop(NativeBoard(), scenario, params)
    labels = {line.label for line in quad_plots.plots(flown, closed=True)[0].lines}
    assert labels - {line.label for line in quad_plots.plots(flown, closed=False)[0].lines} == {"setpoint"}
