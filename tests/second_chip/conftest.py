"""The flash image on the second chip model, switched on and ready to be spoken to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from plumb import systems
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.link.session import Session
from plumb.tuning.quantise import quantise
from second_chip import CanEnd, Chip, UartEnd

IMAGE = Path(__file__).parents[2] / "build/stm32f103/firmware.bin"
START_S = 0.06
"""The check of the image and the way onto the CAN bus take this long."""


@pytest.fixture(scope="session")
def image() -> bytes:
    if not IMAGE.exists():
        pytest.skip("no flash image; build it with: make image")
    return IMAGE.read_bytes()


@pytest.fixture(scope="session")
def wheels_image() -> bytes:
    """Of the pin set whose motors the image of all systems does not have."""
    try:
        return find_image(Path("wheels")).read_bytes()
    except UsageError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def wheels_flash(wheels_image: bytes) -> bytes:
    """The whole flash of a board that was told this pin set."""
    module = systems.load("wheels")
    params = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    told = Chip(wheels_image)
    told.run(START_S)
    with Session.open(UartEnd(told)) as session:
        link = {**params.link_words(), **module.LINK, "arm_hold_ms": 0, "battery_min_mv": 6_400}
        session.upload(params.words(), period_us=module.PERIOD_US, **link)
        session.execute("SAVE")
    return bytes(told.flash)


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
