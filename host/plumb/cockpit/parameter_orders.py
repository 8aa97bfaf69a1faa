"""Orders about the parameters of a board, in units: list, describe, set.

The answers to a page come from the table that the loop knows, not from the board: describing takes a while, in which an
armed board would wait for a keep-alive. Gains that the table declares live change while the run goes on. An armed board
takes a live gain to at most twice or half of what it was at arming; everything else is locked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plumb.api.parameters import description
from plumb.cockpit.page_orders import Order
from plumb.errors import UsageError
from plumb.spec.parameter_file import by_name
from plumb.spec.parameters import Parameter, table
from plumb.tuning import quantities
from plumb.tuning.quantities import Value

LOCKED = "Locked while the board is armed: only a gain marked live changes then."
LOCKED_AT_0 = "Locked while the board is armed: a gain of 0 stays 0 then."


@dataclass(frozen=True)
class Write:
    """A table to be committed. live: the run goes on with it. said: what it changes."""

    values: Mapping[str, int]
    live: bool
    said: str


def answer(
    order: Order, words: Sequence[int], armed: bool, at_arming: Sequence[int] | None = None
) -> dict[str, object]:
    """`parameters`: name, value and whether it is live, of all. `describe`: unit, limits and meaning of one."""
    values = by_name(words)
    if order.verb == "parameters":
        return {"parameters": listed(values)}
    return {"parameter": described(values, order.name, armed, at_arming)}


def listed(values: Mapping[str, int]) -> list[dict[str, object]]:
    """Every parameter in units."""
    live = live_names(values)
    found = quantities.values_of(values).items()
    return [{"name": name, "value": value, "live": name in live} for name, value in found]


def live_names(values: Mapping[str, int]) -> set[str]:
    """Names of the parameters whose integers are all live."""
    groups = {row.group for row in table() if row.live}
    names = [name for name in quantities.values_of(values) if name.split(".")[0] in groups]
    return {name for name in names if (rows := quantities.rows_of(name, values)) and all(row.live for row in rows)}


def described(
    values: Mapping[str, int], name: str, armed: bool, at_arming: Sequence[int] | None = None
) -> dict[str, object]:
    """Entry of a parameter for a page. armed: with the limits of an armed board, or the reason why it is locked.
    at_arming: the table with which it was armed, None for that in use."""
    said = description(name, values)
    rows = [row for row in table() if row.name in said.words]
    limits, locked = [said.min, said.max], ""
    if armed:
        locked = _lock(rows, values)
        first = values if at_arming is None else by_name(at_arming)
        value = description(name, first).value
        if not locked and isinstance(value, int | float):
            limits = _armed_limits(value, limits, rows, first)
    shown = [None if limit is None or not math.isfinite(limit) else limit for limit in limits]
    return {"unit": said.unit, "value": said.value, "limits": shown, "meaning": said.meaning, "locked": locked}


def _lock(rows: Sequence[Parameter], values: Mapping[str, int]) -> str:
    if not rows or not all(row.live for row in rows):
        return LOCKED
    return LOCKED_AT_0 if any(values[row.name] == 0 for row in rows) else ""


def _armed_limits(
    value: float, limits: Sequence[float | None], rows: Sequence[Parameter], values: Mapping[str, int]
) -> list[float | None]:
    """Half and twice a gain as its integers have them, within its limits."""
    sizes = [abs(values[row.name]) for row in rows]
    half = max((size + 1) // 2 / size for size in sizes)
    low, high = sorted((half * value, 2.0 * value))
    least, most = limits
    return [low if least is None else max(low, least), high if most is None else min(high, most)]


def write(order: Order, words: Sequence[int]) -> Write:
    """The table with the value of a `set`. Raises UsageError for a name that there is not, or a value that the board
    could not hold."""
    values = by_name(words)
    name = quantities.find(order.name, quantities.quantities_of(values)).name
    before = quantities.values_of(values)[name]
    value: Value = order.choice or order.value
    if isinstance(before, int) and not order.choice and order.value.is_integer():
        value = int(order.value)
    after = quantities.changed(values, {name: value})
    changed = [row for row in table() if values[row.name] != after[row.name]]
    said = f"{name}: {_shown(before)} -> {_shown(quantities.values_of(after)[name])}"
    return Write(after, all(row.live for row in changed), said)


def require_armed_change(wanted: Write, words: Sequence[int], at_arming: Sequence[int] | None = None) -> None:
    """Raise UsageError for a write that an armed board refuses: the reason in one sentence. at_arming: the table with
    which it was armed, None for that in use."""
    values, first = by_name(words), by_name(words if at_arming is None else at_arming)
    for row in table():
        before, after = values[row.name], wanted.values[row.name]
        if before == after:
            continue
        if not row.live:
            raise UsageError("the board is armed: only a gain marked live changes; stop it first")
        a, b = abs(first[row.name]), abs(after)
        if first[row.name] * after <= 0 or not (a <= 2 * b and b <= 2 * a):
            raise UsageError("the board is armed: a gain goes at most to half or twice its value at arming")


def _shown(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"
