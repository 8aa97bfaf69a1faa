"""The report page is one file that stands alone, and no plot hides a spike."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from plumb.boards.native import NativeBoard
from plumb.errors import UsageError
from plumb.proof import report, runs
from plumb.systems.quad import plots as quad_plots
from plumb.systems.quad.scenarios import TUNINGS
from plumb.systems.quad.scenarios import scenario as quad_scenario
from plumb.tuning.quantise import quantise

TIME_S = np.arange(50_000) / 1000.0


def test_a_single_spike_survives_thinning() -> None:
    values = np.zeros_like(TIME_S)
    values[31_415] = 7.0
    time_s, kept = report.thin(TIME_S, values)
    assert len(kept) <= report.POINTS_MAX
    assert kept.max() == 7.0
    assert time_s[int(kept.argmax())] == TIME_S[31_415]


def test_thinned_points_stay_in_order_of_time() -> None:
    time_s, _ = report.thin(TIME_S, np.sin(TIME_S * 40.0))
    assert np.all(np.diff(time_s) > 0)


def test_a_stretch_without_values_is_a_gap_not_an_error() -> None:
    values = np.where(TIME_S < 25.0, np.nan, 1.0)
    _, kept = report.thin(TIME_S, values)
    assert np.isnan(kept[0]) and kept[-1] == 1.0


@pytest.fixture(scope="module")
def page() -> str:
    pytest.importorskip("matplotlib", reason="the report needs the extra report")
    plot = report.Plot("true <tilt>", "deg", TIME_S, [report.Line("tilt", np.sin(TIME_S), "#000000")])
    table = report.Table("Errors", ["who", "rms"], [["a & b", "1"], ["c", "2"]], bad_rows=frozenset({1}))
    return report.page("A run", "pass", "All is well.", [plot, table])


def test_the_page_loads_nothing_from_elsewhere(page: str) -> None:
    assert not re.search(r'(?:src|href)="(?!#)', page)
    assert "<script" not in page and "@import" not in page


def test_text_is_escaped_and_bad_rows_are_marked(page: str) -> None:
    assert "a &amp; b" in page and "true &lt;tilt&gt;" in page
    assert page.count('<tr class="bad">') == 1


def test_the_page_is_the_same_every_time(page: str) -> None:
    plot = report.Plot("true <tilt>", "deg", TIME_S, [report.Line("tilt", np.sin(TIME_S), "#000000")])
    table = report.Table("Errors", ["who", "rms"], [["a & b", "1"], ["c", "2"]], bad_rows=frozenset({1}))
    assert report.page("A run", "pass", "All is well.", [plot, table]) == page


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
    assert page.count('<div class="plot"><svg') == 1 and "overflow-x: auto" in page


def test_a_closed_loop_shows_what_was_asked_for() -> None:
    params, scenario = quantise(TUNINGS["adaptive"]), quad_scenario("hold", 1000, seconds=2.0)
    flown = runs.closed_loop(NativeBoard(), scenario, params)
    labels = {line.label for line in quad_plots.plots(flown, closed=True)[0].lines}
    assert labels - {line.label for line in quad_plots.plots(flown, closed=False)[0].lines} == {"setpoint"}
