"""board.params: the parameters of a board in units, committed as a whole table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import plumb
from plumb.api.connection import Board
from plumb.errors import UsageError
from plumb.spec import declarations, parameters


@pytest.fixture
def board() -> Iterator[Board]:
    with plumb.connect("native", system="quad") as board:
        yield board


def test_a_value_is_read_as_it_was_written(board: Board) -> None:
    params = board.params
    before = params.words
    params["pid.kp"] = 0.05
    assert params["pid.kp"] == params["pid.kp_per_deg"] == pytest.approx(0.05, rel=1e-3)
    after = params.words
    assert {name for name in after if after[name] != before[name]} == {"pid.kp_q22"}
    assert after["pid.kp_q22"] == round(0.05 * 360 * 2**22)


def test_several_values_are_one_commit(board: Board) -> None:
    board.params.update({"kalman.bias_max": 200.0, "esc.max_us": 1900, "arm_hold_ms": 500, "tilt": "arcsine"})
    found = board.params.read()
    assert found["kalman.bias_max_dps"] == pytest.approx(200.0, rel=1e-3)
    assert (found["esc.max_us"], found["arm_hold_ms"], found["tilt"]) == (1900.0, 500, "arcsine")
    assert found["kalman.q_angle_deg2_per_s"] == pytest.approx(2e-4 / 0.02, rel=1e-3)


@pytest.mark.parametrize(("name", "value"), [("trust.r", 1.0), ("kalman.q_angle", 0.01), ("start.p00", 100.0)])
def test_variances_keep_what_they_mean(board: Board, name: str, value: float) -> None:
    """A new variance may be counted in another unit: the others are written in it, too."""
    before = board.params.read()
    board.params[name] = value
    after = board.params.read()
    whole = board.params.describe(name).name
    assert after[whole] == pytest.approx(value, rel=1e-3)
    for other, was in before.items():
        if other != whole:
            assert after[other] == (was if isinstance(was, str) else pytest.approx(was, rel=1e-3)), other


def test_the_period_is_that_of_filter_and_timer(board: Board) -> None:
    board.params["period_us"] = 10_000
    assert board.params["period_us"] == 10_000
    assert board.params.tuning.period_s == pytest.approx(0.01)
    assert board.params["kalman.q_angle"] == pytest.approx(2e-4 / 0.02, rel=1e-3)


def test_the_tuning_of_a_board_is_one_for_a_run(board: Board) -> None:
    board.params["pid.kp"] = 0.03
    result = board.run("quad", scenario="hold", seconds=12, tuning=board.params.tuning)
    assert result.bit_exact and result.params["pid.kp_q22"] == board.params.words["pid.kp_q22"]


def test_a_description_says_unit_meaning_and_words(board: Board) -> None:
    about = board.params.describe("pid.kp")
    assert (about.name, about.alias, about.unit) == ("pid.kp_per_deg", "pid.kp", "1/deg")
    assert about.words == ("pid.kp_q22",) and "proportional" in about.meaning
    assert board.params.describe("arm_hold_ms").unit == "ms"
    assert board.params.describe("start.p00").words == ("start.p00_hi", "start.p00_lo")


@pytest.mark.parametrize(
    "name", ["pid.kp", "kalman.bias_max", "esc.max", "esc.mid", "start.tilt", "arm_hold_ms", "period_us"]
)
def test_limits_are_the_last_values_that_are_taken(board: Board, name: str) -> None:
    about = board.params.describe(name)
    assert about.min is not None and about.max is not None and about.min <= about.value <= about.max  # type: ignore[operator]
    for limit in (about.min, about.max):
        board.params[name] = limit
        held = board.params[name]
        assert not isinstance(held, str) and abs(held) == pytest.approx(abs(limit), rel=1e-12)
        board.params[name] = about.value
        beyond = limit + (1 if limit == about.max else -1) * (1 if isinstance(limit, int) else 2e-3 * abs(limit) + 1e-6)
        with pytest.raises(plumb.UsageError):
            board.params[name] = beyond


def test_limits_of_the_integers_are_those_of_the_table(board: Board) -> None:
    """Gains against the limits of their words; a minimum that ends at its maximum; a choice, which has none."""
    kp, rows = board.params.describe("pid.kp"), {row.name: row for row in parameters.table()}
    assert (kp.min, kp.max) == (rows["pid.kp_q22"].min / 2**22 / 360, rows["pid.kp_q22"].max / 2**22 / 360)
    hold = board.params.describe("arm_hold_ms")
    assert (hold.min, hold.max) == (rows["arm_hold_ms"].min, rows["arm_hold_ms"].max)
    assert board.params.describe("esc.min").max == board.params["esc.mid"]
    assert (board.params.describe("tilt").min, board.params.describe("tilt").max) == (None, None)
    assert board.params.describe("pid.slew").max == float("inf")


@pytest.mark.parametrize("system", declarations.names())
def test_every_tuning_has_names_that_are_found(system: str) -> None:
    """Without a board: the names of each system's default tuning, and the words that hold them."""
    from plumb.contract.parameters import quantise
    from plumb.tuning import quantities

    params = quantise(plumb.Estimator(system).tuning)
    words = parameters.whole_table(params.words(), **params.link_words())
    table = {row.name: row.from_word(word & 0xFFFFFFFF) for row, word in zip(parameters.table(), words, strict=True)}
    found = quantities.quantities_of(table)
    assert set(found) == set(quantities.values_of(table))
    for whole, one in found.items():
        assert quantities.find(one.alias, found) is quantities.find(whole, found) is one
        assert one.unit and one.meaning
    held = {row.name for name in found for row in quantities.rows_of(name, table)}
    derived = {"kalman.dt_s_q33", "kalman.rate_gain", "kalman.rate_shift", "system", parameters.UNIT}
    assert set(params.own()) - held - derived < {name for name in params.own() if "." in name}
    # Most words have a name in units; the others are derived, or are counts.
    assert len(held) > 0.6 * len(params.own())


@pytest.mark.parametrize(
    ("name", "said"),
    [("pid.kpp", "did you mean pid.kp"), ("pid.kp_q22", "an integer of the table"), ("", "names them all")],
)
def test_unknown_names_are_refused(board: Board, name: str, said: str) -> None:
    with pytest.raises(plumb.UsageError, match=said):
        _ = board.params[name]
    with pytest.raises(plumb.UsageError, match=said):
        board.params[name] = 1.0


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("pid.kp", float("nan"), "finite"),
        ("pid.kp", 1e9, "the most is"),
        ("pid.kp", "fast", "give a number"),
        ("tilt", "arctan", "arcsine or atan2"),
        ("tilt", 1, "give arcsine or atan2"),
        ("arm_hold_ms", 1e9, "outside"),
        ("arm_hold_ms", 0.5, "whole"),
        ("arm_hold_ms", float("inf"), "whole"),
        ("period_us", 100, "periods|outside"),
        ("esc.min", 2100.0, "outside|more than"),
        ("pid.kp", True, "give a number"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(board: Board, name: str, value: float | str, said: str) -> None:
    before = board.params.words
    with pytest.raises(plumb.UsageError, match=said):
        board.params.update({"pid.kd": 0.01, name: value})
    assert board.params.words == before


def test_an_armed_board_takes_gains_within_a_factor_of_two_and_stays_armed() -> None:
    with plumb.connect("native", system="quad", scenario="hold") as board:
        samples = board.stream()
        while next(samples).time_s < 0.6:
            pass
        board.arm()
        kp = board.params["pid.kp"]
        assert isinstance(kp, float)
        for value in (1.9 * kp, kp):
            board.params["pid.kp"] = value
            assert board.params["pid.kp"] == pytest.approx(value, rel=1e-3)
        refused: list[tuple[dict[str, float], str]] = [
            ({"pid.kp": 3.0 * kp}, f"pid.kp = .* is more than twice .*: an armed board takes {2.0 * kp:.4g} at most"),
            ({"pid.kp": 0.3 * kp}, "pid.kp = .* is less than half of .*: an armed board takes .* at least"),
            ({"pid.kd": 0.0}, "no gain of an armed board goes to zero"),
            ({"esc.max_us": 1700.0}, "esc.max stays: only gains .* disarm it first"),
            ({"period_us": 10_000.0}, "period_us stays: only gains .* disarm it first"),
        ]
        for values, sentence in refused:
            with pytest.raises(UsageError, match=sentence):
                board.params.update(values)
        with pytest.raises(UsageError, match="is armed, and SAVE would end its run"):
            board.params.save()
        assert board.params["pid.kp"] == pytest.approx(kp, rel=1e-3)
        last = [next(samples) for _ in range(60)]
        assert last[-1].armed and [sample.armed for sample in last] == sorted(sample.armed for sample in last)
        board.disarm()


@pytest.fixture
def own_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What other tests keep of the native board is not seen."""
    for place in ("CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{place}_HOME", str(tmp_path / place))


@pytest.mark.usefixtures("own_places")
def test_integers_are_written_and_the_change_is_taken_back_from_what_is_kept(board: Board) -> None:
    params, before = board.params, board.params.words
    params.write_words({**before, "arm_hold_ms": before["arm_hold_ms"] + 100})
    after = params.words
    assert after != before
    kept = params.kept
    kept.add("by hand", before, after)
    kept.add("nothing", after, after)
    assert [change.did for change in kept.changes] == ["by hand"] and kept.before_last(after) == before
    params.write_words(kept.before_last(after), after)
    kept.forget_last(after)
    assert params.words == before and kept.changes == []
    with pytest.raises(UsageError, match="nothing to undo"):
        kept.before_last(before)


@pytest.mark.usefixtures("own_places")
def test_saved_and_factory_values_come_back_and_a_table_has_a_name(board: Board) -> None:
    params = board.params
    params["arm_hold_ms"] = 700
    path = params.kept.save_profile("slow", params.read_words())
    assert params.kept.profiles == ["slow"] and params.kept.holds("slow", params.words)
    params.save()
    params.reset()
    assert params.words == {row.name: row.default for row in parameters.table()}
    assert not params.kept.holds("slow", params.words)
    params.load()
    assert params["arm_hold_ms"] == 700 and params.kept.holds("slow", params.words)
    assert params.kept.delete_profile("slow") == path and params.kept.profiles == []
