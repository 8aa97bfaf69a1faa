"""The flash image on the second chip model: both links, every system, step by step."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from plumb.boards.link import LinkBoard
from plumb.link.session import Session
from plumb.proof import golden
from plumb.spec.protocol import protocol
from second_chip import CanEnd, Chip, UartEnd

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
IMAGE = ROOT / "build/stm32f103/firmware.bin"
START_S = 0.06
"""The check of the image and the way onto the CAN bus take this long."""
STEPS = 60
"""Of every vector. A step's digest covers the state that all steps before it left."""
LINKS: dict[str, Callable[[Chip], Session]] = {
    "uart": lambda chip: Session.open(UartEnd(chip)),
    "can": lambda chip: Session.over(CanEnd(chip)),
}
VECTORS = golden.load(ROOT / "tests/vectors")


def booted() -> Chip:
    if not IMAGE.exists():
        pytest.skip("no flash image; build it with: make image")
    chip = Chip(IMAGE.read_bytes())
    chip.run(START_S)
    return chip


@pytest.fixture(params=LINKS)
def session(request: pytest.FixtureRequest) -> Iterator[Session]:
    with LINKS[request.param](booted()) as opened:
        yield opened


def test_the_model_shares_no_code_with_the_virtual_board() -> None:
    imported = "import sys, second_chip; print(*sorted(sys.modules))"
    said = subprocess.run([sys.executable, "-c", imported], cwd=ROOT / "tests", capture_output=True, check=True)
    assert not [name for name in said.stdout.decode().split() if name.partition(".")[0] == "plumb"]
    for path in HERE.glob("*.py"):
        if not path.name.startswith("test_"):
            for node in ast.walk(ast.parse(path.read_text())):
                names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                assert not [name for name in names if name.partition(".")[0] == "plumb"], path


def test_the_board_says_who_it_is_over_both_links(session: Session) -> None:
    identity = session.identity
    assert identity is not None and identity.mismatch is None
    assert identity["DBC_HASH"] == protocol().dbc_hash
    assert identity["FLASH_KIB"] == 64 and identity["PART_ID"] == 0x410
    assert identity["FAULTS"] == 0


def test_two_runs_are_alike_to_the_byte() -> None:
    texts = []
    for _ in range(2):
        end = UartEnd(booted())
        end.write(b"\rC\rO\r")
        texts.append(b"".join(end.read(4096) for _ in range(300)))
    assert texts[0] and texts[0] == texts[1]


@pytest.mark.parametrize("system", sorted({vector.system for vector in VECTORS}))
def test_every_digest_of_a_lockstep_run_is_the_golden_one(session: Session, system: str) -> None:
    board = LinkBoard("second chip", session)
    for vector in [v for v in VECTORS if v.system == system and v.on_link][:3]:
        answer = board.run_injected(vector.params, vector.raw[:STEPS], vector.setpoint[:STEPS])
        assert np.array_equal(answer.digests, vector.digests[:STEPS]), vector.name
