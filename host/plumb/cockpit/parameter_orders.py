"""Orders about the parameters of a board, in units: list, describe, set, save."""

from __future__ import annotations

import math

from plumb.api.parameters import Parameters
from plumb.cockpit.page_orders import Order
from plumb.link.session import Session
from plumb.tuning.quantities import Value


def read(session: Session, order: Order) -> dict[str, object]:
    """`parameters`: every name and value. `describe`: unit, limits and meaning of one."""
    board = Parameters(session)
    if order.verb == "parameters":
        return {"parameters": list(board.read().items())}
    said = board.describe(order.name)
    limits = [None if limit is None or not math.isfinite(limit) else limit for limit in (said.min, said.max)]
    return {"parameter": {"unit": said.unit, "value": said.value, "limits": limits, "meaning": said.meaning}}


def write(session: Session, order: Order) -> str:
    """`set` and `save`; both end the run. Returns what was done."""
    board = Parameters(session)
    if order.verb == "save":
        board.save()
        return "the parameters in use are saved to the board's flash"
    before = board[order.name]
    value: Value = order.choice or order.value
    if isinstance(before, int) and not order.choice and order.value.is_integer():
        value = int(order.value)
    board[order.name] = value
    return f"{order.name}: {_shown(before)} -> {_shown(board[order.name])}"


def _shown(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"
