"""The flash image on the second chip model, switched on and ready to be spoken to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from plumb.link.session import Session
from second_chip import CanEnd, Chip, UartEnd

BUILD = Path(__file__).parents[2] / "build"
IMAGE, FLYING = BUILD / "stm32f103/firmware.bin", BUILD / "images/quadrotor/firmware.bin"
START_S = 0.06
"""The check of the image and the way onto the CAN bus take this long."""


@pytest.fixture(scope="session")
def image() -> bytes:
    if not IMAGE.exists():
        pytest.skip("no flash image; build it with: make image")
    return IMAGE.read_bytes()


@pytest.fixture(scope="session")
def flying_image() -> bytes:
    """The image `quadrotor`, which `make image` builds in addition to that of all."""
    if not FLYING.exists():
        pytest.skip("no flash image of quadrotor; build it with: make image")
    return FLYING.read_bytes()


@pytest.fixture
def chip(image: bytes) -> Chip:
    started = Chip(image)
    started.run(START_S)
    return started


Connect = Callable[[Chip], Session]
"""Opens a session, and closes it when the test is over."""


@pytest.fixture(params=["uart", "can"])
def connect(request: pytest.FixtureRequest) -> Iterator[Connect]:
    """Over each of the two links."""
    with ExitStack() as opened:
        if request.param == "can":
            yield lambda chip: opened.enter_context(Session.over(CanEnd(chip)))
        else:
            yield lambda chip: opened.enter_context(Session.open(UartEnd(chip)))


@pytest.fixture
def connect_uart() -> Iterator[Connect]:
    """For what does not depend on the link."""
    with ExitStack() as opened:
        yield lambda chip: opened.enter_context(Session.open(UartEnd(chip)))


@pytest.fixture
def session(chip: Chip, connect: Connect) -> Session:
    return connect(chip)
