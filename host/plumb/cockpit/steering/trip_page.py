"""An open page of a trip: sticks and orders from it, the scene and the state to it, and the files that it is made of.

Sticks come 50 times a second, as {"do": "sticks", "tick": N, "roll": .., "pitch": .., "yaw": .., "throttle": ..,
"on": .., "rate": ..}; what is no such message is an order.
"""

from __future__ import annotations

import json
from collections.abc import Callable

from aiohttp import web

from plumb.cockpit import page_orders
from plumb.cockpit.page_orders import Order
from plumb.cockpit.page_server import Page
from plumb.cockpit.steering.transmitter import Sticks
from plumb.cockpit.steering.trip_loop import HAPPEN, NEW, TripLoop
from plumb.errors import UsageError

STICKS = "sticks"
SHARED = ("dom", "light", "link")
"""Modules of the cockpit's page that this one uses."""
OWN = ("gauges", "hands", "scene", "shader", "steering", "vehicle", "words")
ASSETS = {
    "": ("steering/index.html", "text/html"),
    "steering.css": ("steering/steering.css", "text/css"),
    "ogl.min.js": ("steering/ogl.min.js", "text/javascript"),
    **{f"{name}.js": (f"steering/{name}.js", "text/javascript") for name in OWN},
    **{f"{name}.js": (f"{name}.js", "text/javascript") for name in SHARED},
}
"""As plumb.cockpit.page_server.ASSETS."""


class TripPage(Page):
    """trip: what the page shows and steers; the other arguments as of Page."""

    def __init__(
        self, trip: TripLoop, socket: web.WebSocketResponse, abort: Callable[[], None], number: int, control: bool
    ) -> None:
        super().__init__(socket, abort, trip, number, control)
        self._trip = trip
        self._drawn = False

    async def _rows(self) -> None:
        """The drawing once, then the scene."""
        if not self._drawn:
            self._drawn = True
            await self._text({"type": "drawing", **self._trip.drawing()})
        await self._text({"type": "scene", "tick": self._board.hold.next_tick(), **self._trip.scene})

    def _handle_message(self, text: str) -> None:
        try:
            said = _object(text)
            if said.get("do") == STICKS:
                sticks = sticks_of(said)
                self._board.hold.beat(self._number, _tick(said))
                self._trip.accept_sticks(self._number, sticks)
                return
            order = _order(said, self._number, {str(event["name"]) for event in self._trip.events})
        except UsageError as error:
            self._answers.append({"number": 0, "good": False, "text": str(error)})
            return
        if order is None:
            super()._handle_message(text)
        elif not self._control:
            self._answers.append({"number": order.number, "good": False, "text": "this page only watches"})
        else:
            self._board.order(order, lambda answer: self._answers.append({"number": order.number, **answer}))


def _object(text: str) -> dict[str, object]:
    if len(text) > page_orders.MOST_BYTES:
        raise UsageError(f"an order has at most {page_orders.MOST_BYTES} characters")
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        raise UsageError("an order is one JSON object") from None
    if not isinstance(said, dict):
        raise UsageError("an order is one JSON object")
    return said


def sticks_of(said: dict[str, object]) -> Sticks:
    """The sticks in a message of a page. Raises UsageError for a value that is no number, or beyond its ends."""
    names = {"roll": -1.0, "pitch": -1.0, "yaw": -1.0, "throttle": 0.0}
    numbers = {name: said.get(name, 0.0) for name in names}
    switches = {name: said.get(name, False) for name in ("on", "rate")}
    for name, low in names.items():
        number = numbers[name]
        if isinstance(number, bool) or not isinstance(number, int | float) or not low <= number <= 1.0:
            raise UsageError(f"{name} is a number from {low:g} to 1")
    if not all(isinstance(switch, bool) for switch in switches.values()):
        raise UsageError("on and rate are true or false")
    return Sticks(**numbers, **switches)  # type: ignore[arg-type]  # checked above


def _tick(said: dict[str, object]) -> int:
    tick = said.get("tick", 0)
    if isinstance(tick, bool) or not isinstance(tick, int):
        raise UsageError("tick is a whole number")
    return tick


def _order(said: dict[str, object], page: int, events: set[str]) -> Order | None:
    """An order of a trip; None: it is one of every page."""
    number = said.get("number", 0)
    if said.get("do") not in (NEW, HAPPEN):
        return None
    if isinstance(number, bool) or not isinstance(number, int):
        raise UsageError("number is a whole number")
    if said["do"] == HAPPEN and said.get("name") not in events:
        raise UsageError(f"name one of {', '.join(sorted(events))}")
    return Order(str(said["do"]), page, number, name=str(said.get("name", "")))
