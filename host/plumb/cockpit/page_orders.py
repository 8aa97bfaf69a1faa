"""Orders of a page: JSON from a browser, checked into an Order. Raises UsageError for anything else."""

from __future__ import annotations

import json
from dataclasses import dataclass

from plumb.errors import UsageError

HEARTBEAT, STOP = "alive", "stop"
FREE = frozenset({STOP})
"""Orders that every page may give."""
FOR_CONTROL = frozenset({"take"})
"""Orders of a page that was opened with the control address."""
FOR_HOLDER = frozenset(
    {"release", "arm", "run", "setpoint", "record", "parameters", "describe", "set", "save", "step_test"}
)
"""Orders of the page that holds the board."""
MOST_BYTES = 4096
NUMBERS = {"setpoint": ("value",), "step_test": ("value", "seconds"), "set": ("value",)}
"""Order -> the numbers that it needs."""
NAMED = frozenset({"describe", "set"})
"""Orders that name a parameter."""
LONGEST_NAME = 80
LARGEST = 1e15


@dataclass(frozen=True)
class Order:
    """page: who gives it; number: the page's own, repeated in the answer; tick: of a heartbeat."""

    verb: str
    page: int
    number: int = 0
    tick: int = 0
    name: str = ""
    on: bool = False
    value: float = 0.0
    seconds: float = 0.0
    choice: str = ""
    """For `set`: the new value of a parameter that is a choice."""


def parse(text: str, page: int) -> Order:
    """The order in a message of a page."""
    if len(text) > MOST_BYTES:
        raise UsageError(f"an order has at most {MOST_BYTES} characters")
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        raise UsageError("an order is one JSON object") from None
    verb = said.get("do") if isinstance(said, dict) else None
    if not isinstance(verb, str) or verb not in FREE | FOR_CONTROL | FOR_HOLDER | {HEARTBEAT}:
        raise UsageError("an order names what to do")
    choice = said.get("value") if verb == "set" else None
    wanted = () if isinstance(choice, str) else NUMBERS.get(verb, ())
    if isinstance(choice, str) and not 0 < len(choice) <= LONGEST_NAME:
        raise UsageError("set: give a value")
    numbers = {name: _number(said, name) for name in wanted}
    name = said.get("name", "")
    if verb in NAMED and not (isinstance(name, str) and 0 < len(name) <= LONGEST_NAME):
        raise UsageError(f"{verb}: name a parameter")
    on = said.get("on", False)
    if verb == "record" and not isinstance(on, bool):
        raise UsageError("record: on is true or false")
    return Order(
        verb,
        page,
        _whole(said, "number"),
        _whole(said, "tick"),
        name if verb in NAMED else "",
        on if verb == "record" else False,
        choice=choice if isinstance(choice, str) else "",
        **numbers,
    )


def _number(said: dict[str, object], name: str) -> float:
    value = said.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise UsageError(f"{name} is a number of at most {LARGEST:g}")
    return float(value)


def _whole(said: dict[str, object], name: str) -> int:
    value = said.get(name, 0)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 1 << 32:
        raise UsageError(f"{name} is a whole number")
    return value
