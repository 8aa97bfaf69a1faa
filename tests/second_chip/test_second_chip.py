"""The flash image on the second chip model: both links, and every system step by step."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from plumb.boards.link import LinkBoard
from plumb.link.session import Session
from plumb.proof import golden
from plumb.spec import declarations
from plumb.spec.protocol import protocol
from second_chip import Chip, UartEnd
from second_chip.clocks import UNITS_HZ
from second_chip.interrupts import FIRST_IRQ, NMI

from .conftest import START_S, Connect

HERE = Path(__file__).parent
STEPS = 60
"""Of every vector. A step's digest covers the state that all steps before it left."""
CRYSTAL_WAIT_S = 0.1
CLOCK_FALLBACK, CRYSTAL_FAILED = 0x0100, 0x1000


def test_the_model_shares_no_code_with_the_virtual_board() -> None:
    listing = "import sys, second_chip; print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", listing], cwd=HERE.parent, capture_output=True, check=True, text=True)
    assert "second_chip.chip" in said.stdout.split()
    assert not [name for name in said.stdout.split() if name.partition(".")[0] == "plumb"]
    model = [path for path in HERE.glob("*.py") if not path.name.startswith(("test_", "conftest"))]
    for node in (node for path in model for node in ast.walk(ast.parse(path.read_text()))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert not [name for name in names if name.partition(".")[0] == "plumb"]


def test_the_board_says_who_it_is_over_both_links(session: Session) -> None:
    identity = session.identity
    assert identity is not None and identity.mismatch is None
    assert identity["DBC_HASH"] == protocol().dbc_hash
    assert (identity["FLASH_KIB"], identity["RAM_KIB"], identity["PART_ID"]) == (64, 20, 0x410)
    assert identity["FAULTS"] == 0


def keep(read: Callable[[int], bytes], received: list[bytes], count: int) -> bytes:
    received.append(read(count))
    return received[-1]


def test_two_boards_say_the_same_to_the_byte(image: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nonces, too: they come from what the memory held when it was switched on."""
    texts = []
    for _ in range(2):
        chip = Chip(image)
        chip.run(START_S)
        end = UartEnd(chip)
        received: list[bytes] = []
        monkeypatch.setattr(end, "read", partial(keep, end.read, received))
        with Session.open(end) as session:
            arm = session.protocol["EXECUTE"].value("verb", "ARM")
            session.request("CHALLENGE", arm, 0, answer="NONCE", first=arm)
        texts.append(b"".join(received))
    assert texts[0].count(b"\r") > 25
    assert texts[0] == texts[1]


def test_without_a_crystal_the_board_says_so_at_64_mhz(image: bytes, connect_uart: Connect) -> None:
    chip = Chip(image, crystal=False)
    chip.run(CRYSTAL_WAIT_S + START_S)
    identity = connect_uart(chip).identity
    assert identity is not None and identity["FAULTS"] == CLOCK_FALLBACK
    assert chip.rcc.cycle * 64_000_000 == UNITS_HZ


def test_a_crystal_that_fails_restarts_the_board_without_it(chip: Chip, connect_uart: Connect) -> None:
    chip.rcc.crystal_fails()
    chip.run(START_S)
    identity = connect_uart(chip).identity
    assert identity is not None and identity["FAULTS"] == CLOCK_FALLBACK | CRYSTAL_FAILED
    assert chip.resets == 1 and identity["CRASH_EXCEPTION"] == NMI


def test_an_interrupt_waits_for_equal_priority_and_repeats_while_pending(chip: Chip) -> None:
    nvic = chip.nvic
    nvic.reset()
    for irq, priority in ((5, 0x80), (6, 0x80), (7, 0x40)):
        nvic.enabled |= 1 << FIRST_IRQ + irq
        nvic.priority[FIRST_IRQ + irq] = priority
    nvic.line(6, True)
    nvic.line(5, True)
    assert nvic.next(masked=True) is None
    assert nvic.next(masked=False) == FIRST_IRQ + 5, "the lower number of two alike"
    nvic.enter(FIRST_IRQ + 5)
    assert nvic.next(masked=False) is None
    nvic.line(7, True)
    assert nvic.next(masked=False) == FIRST_IRQ + 7, "a higher priority interrupts"
    nvic.leave()
    assert nvic.pending >> FIRST_IRQ == 1 << 5 | 1 << 6 | 1 << 7, "its line is still high"


@pytest.mark.parametrize("system", sorted(name for name, one in declarations.systems().items() if one.in_all))
def test_every_digest_of_a_lockstep_run_is_the_golden_one(session: Session, system: str) -> None:
    board = LinkBoard("second chip", session)
    vectors = [vector for vector in golden.load(HERE.parent / "vectors", [system]) if vector.on_link][:2]
    assert vectors
    for vector in vectors:
        answer = board.run_injected(vector.params, vector.raw[:STEPS], vector.setpoint[:STEPS])
        assert np.array_equal(answer.digests, vector.digests[:STEPS]), vector.name
