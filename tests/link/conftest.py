"""One body, two ports: a test that takes `new_board` runs on the native port and on the flash image."""

from __future__ import annotations

from typing import cast

import pytest

from plumb.errors import UsageError
from support.native_board import NewBoard, UartBoard
from support.port_only import NATIVE_ONLY


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what the list says, and hold the list to what there is."""
    out = [item for item in items if _on_flash(item) and NATIVE_ONLY.keys() & _names(item)]
    config.hook.pytest_deselected(items=out)
    items[:] = [item for item in items if item not in out]


def _on_flash(item: pytest.Item) -> bool:
    callspec = getattr(item, "callspec", None)
    return callspec is not None and callspec.params.get("new_board") == "flash"


def _names(item: pytest.Item) -> set[str]:
    """Of the test, and of the test with its other parameters."""
    assert isinstance(item, pytest.Function)
    parameters = [part for part in item.callspec.id.split("-") if part != "flash"]
    return {item.originalname, f"{item.originalname}[{'-'.join(parameters)}]"}


@pytest.fixture(params=["native", "flash"])
def new_board(request: pytest.FixtureRequest) -> NewBoard:
    if request.param == "native":
        return UartBoard
    pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")
    from support.flash_board import FlashBoard

    def made() -> UartBoard:
        try:
            return cast(UartBoard, FlashBoard())
        except UsageError as missing:
            pytest.skip(str(missing))

    return made
