"""One comparer names the first step and signal, whether a board gave records or digests."""

from __future__ import annotations

import pytest

from plumb.contract import run_fixed
from plumb.contract.parameters import quantise
from plumb.proof.compare import Divergence, count_mismatches, divergence_at, first_divergence
from plumb.spec.records import Words
from plumb.systems.quad import scenarios as quad

STEPS, WRONG, SIGNAL = 60, 37, "tilt_turn_q32"


@pytest.fixture(scope="module")
def model() -> Words:
    run = quad.scenario("motion", 5, seconds=STEPS * quad.PERIOD_US * 1e-6)
    return run_fixed.run_control(quantise(quad.ADAPTIVE), run.counts()[:STEPS], run.setpoint()[:STEPS])


@pytest.fixture(scope="module")
def board(model: Words) -> Words:
    """As the model, but for one bit of one step."""
    words = Words(model.record.copy())
    words.record[SIGNAL][WRONG] ^= 4
    return words


def row(words: Words, step: int) -> dict[str, int]:
    return {name: int(values[step]) for name, values in words.items()}


def test_records_and_digests_lead_to_the_same_word(model: Words, board: Words) -> None:
    asked: list[int] = []

    def words_of_step(step: int) -> dict[str, int]:
        asked.append(step)
        return row(board, step)

    expected, actual = int(model[SIGNAL][WRONG]), int(board[SIGNAL][WRONG])
    found = Divergence(WRONG, 0, SIGNAL, expected, actual)
    assert first_divergence(model, board) == found
    assert first_divergence(model, board.digests(), words_of_step) == found
    assert asked == [WRONG]
    assert count_mismatches(model, board) == count_mismatches(model.digests(), board.digests()) == 1


def test_nothing_is_asked_for_where_all_digests_agree(model: Words) -> None:
    def words_of_step(step: int) -> dict[str, int]:
        raise AssertionError(f"step {step} was asked for")

    assert first_divergence(model, model.digests(), words_of_step) is None


def test_a_digest_is_named_where_no_word_is_known_to_differ(model: Words, board: Words) -> None:
    expected, actual = int(model.digests()[WRONG]), int(board.digests()[WRONG])
    found = Divergence(WRONG, 0, "digest", expected, actual)
    assert first_divergence(model, board.digests()) == found
    assert first_divergence(model, board.digests(), lambda step: row(model, step)) == found
    assert divergence_at(WRONG, model, {}, actual) == found


@pytest.mark.parametrize("longer", ["model", "board"])
def test_digests_that_end_early_diverge_there(model: Words, longer: str) -> None:
    whole, short = model.digests(), Words(model.record[:40])
    if longer == "model":
        assert first_divergence(model, whole[:40]) == Divergence(40, 0, "digest", int(whole[40]), None)
    else:
        assert first_divergence(short, whole) == Divergence(40, 0, "steps", 40, STEPS)


def test_json_of_a_run_and_of_a_golden_vector() -> None:
    assert list(Divergence(1, 0, "tilt", 2, 3).as_dict().items()) == [
        ("step", 1),
        ("run", 0),
        ("signal", "tilt"),
        ("expected", 2),
        ("actual", 3),
    ]
    assert list(Divergence(1, 0, "tilt", 2, 3, "hold", True).as_dict()) == [
        "vector",
        "step",
        "signal",
        "expected",
        "actual",
        "in_file",
    ]
