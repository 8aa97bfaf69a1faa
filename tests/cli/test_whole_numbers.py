"""Whole numbers of the command line are read in every form that people type; every command reads them so."""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.cli.whole_numbers import flash_offset, whole_number

CLI = Path(front.__file__).parent


@pytest.mark.parametrize("seed", range(20))
def test_every_form_of_a_number_is_that_number(seed: int) -> None:
    rng = random.Random(seed)
    number = rng.randrange(10 ** rng.randrange(1, 12))
    for text in (f"{number}", f"{number:,}", f"{number:_}", f" {number} ", f"{number}.0", f"{number}e2"):
        assert whole_number(text) == (number * 100 if text.endswith("e2") else number)


@pytest.mark.parametrize("text", ["", "1.5", "1e-3", "1,00", "1,0000", "ten", "nan", "inf", "1e999", "0x10"])
def test_what_is_no_whole_number_is_said_with_the_forms(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is no whole number; write for example 1000, 1_000, 1,000"):
        whole_number(text)


def sources() -> Iterator[Path]:
    yield from (CLI / "cli").rglob("*.py")
    yield from (CLI / "judging").rglob("*.py")


def test_no_option_reads_another_kind_of_whole_number() -> None:
    assert [path.name for path in sources() if "type=int" in path.read_text(encoding="utf-8")] == []


def test_a_loop_without_a_setpoint_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["tune", "pid", "--board", "native", "--system", "attitude"]) == 2
    assert "attitude holds no tilt that a host sets" in capsys.readouterr().err


def test_a_file_that_cannot_be_kept_is_told_before_a_board_is_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from plumb.boards import serve

    monkeypatch.setattr(serve, "serve", lambda *_, **__: pytest.fail("served"))
    (tmp_path / "kept.part").mkdir()  # write_whole writes beside the file
    for port in ("native", "f103"):
        given = ["virtual-board", "--port", port, "--keep", str(tmp_path / "kept"), "--serial", "tcp:0"]
        assert front.main(given) == 2
        assert "cannot write" in capsys.readouterr().err


def test_the_simulated_chip_lists_what_it_offers() -> None:
    import plumb.f103

    assert {"Machine", "SimulationError"} <= set(dir(plumb.f103))


def test_an_offset_in_flash_may_be_hexadecimal() -> None:
    assert flash_offset("0x2000") == flash_offset("8192") == flash_offset("8_192") == 0x2000
    with pytest.raises(argparse.ArgumentTypeError, match="'0x20zz' is no whole number"):
        flash_offset("0x20zz")
