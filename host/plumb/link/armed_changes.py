"""Why an armed board refuses a change of its parameters, and what it takes instead, in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from math import ceil, floor, log10

from plumb.errors import UsageError
from plumb.spec import parameters
from plumb.tuning import quantities
from plumb.tuning.quantities import NamedQuantity

PERIOD = "period_us"
GAINS_ONLY = "only gains of controllers change while the board is armed: disarm it first"
NO_ZERO = "no gain of an armed board goes to zero, comes from zero, or changes its sign: disarm it first"


def refusal(
    before: Mapping[str, int],
    after: Mapping[str, int],
    index: int,
    keep_alive: Callable[[], None],
    at_arming: Mapping[str, int] | None = None,
) -> str:
    """The sentence for a refused commit. before, after: whole tables, in use and asked for; at_arming: in use when the
    board was armed, None if that is not known; index: the word that the board named. keep_alive is called between
    calculations: the board that refused is armed, and stays so."""
    rows = parameters.table()
    if not 0 <= index < len(rows):
        return GAINS_ONLY
    row = rows[index]
    if at_arming is not None:
        before = {**before, **{one.name: at_arming[one.name] for one in rows if one.live}}
    if row not in parameters.refused_while_armed(before, after):
        return f"{row.name} = {after[row.name]} is more than twice or less than half of what it was at arming"
    try:
        one = _quantity_of(row, before, after, keep_alive)
    except UsageError:  # integers that stand for no tuning
        one = None
    if one is None:
        return in_integers(row, before[row.name], after[row.name])
    keep_alive()
    old, new = quantities.values_of(before)[one.name], quantities.values_of(after)[one.name]
    if not row.live or one.name == PERIOD or isinstance(old, str) or isinstance(new, str):
        return f"{one.alias} stays: {GAINS_ONLY}"
    if old * new <= 0:
        return f"{one.alias} = {new:g}, which was {old:g}: {NO_ZERO}"
    more = abs(new) > abs(old)
    limit = _nearest(before, one.name, old, 2.0 if more else 0.5, keep_alive)
    return _beyond(one.alias, f"{new:g}", f"{old:g}", f"{limit:g}", more)


def in_integers(row: parameters.Parameter, old: int, new: int) -> str:
    """The same for one word of the table."""
    if not row.live:
        return f"{row.name} stays: {GAINS_ONLY}"
    if old * new <= 0:
        return f"{row.name} = {new}, which was {old}: {NO_ZERO}"
    more = abs(new) > abs(old)
    limit = 2 * abs(old) if more else (abs(old) + 1) // 2
    return _beyond(row.name, str(new), str(old), str(limit if old > 0 else -limit), more)


def _beyond(name: str, new: str, old: str, limit: str, more: bool) -> str:
    if more:
        return f"{name} = {new} is more than twice {old}, its value at arming: an armed board takes {limit} at most"
    return f"{name} = {new} is less than half of {old}, its value at arming: an armed board takes {limit} at least"


def _quantity_of(
    row: parameters.Parameter,
    before: Mapping[str, int],
    after: Mapping[str, int],
    keep_alive: Callable[[], None],
) -> NamedQuantity | None:
    """The quantity that moved the word; the period moves words of many."""
    names, differing = quantities.quantities_of(before), quantities.differing(before, after)
    if PERIOD in differing:
        return names[PERIOD]
    for name in differing:
        keep_alive()
        if row in quantities.rows_of(name, before):
            return names[name]
    return names[differing[0]] if differing and not row.live else None


def _nearest(before: Mapping[str, int], name: str, old: float, factor: float, keep_alive: Callable[[], None]) -> float:
    """The value nearest to `factor` times the old one, to four digits, whose integers the board takes."""
    unit = 10.0 ** (floor(log10(abs(old * factor))) - 3)
    inwards = -1.0 if (factor > 1.0) == (old > 0.0) else 1.0
    units = old * factor / unit
    whole = round(units)
    if abs(units - whole) > 1e-3:
        whole = floor(units) if inwards < 0.0 else ceil(units)
    value = float(f"{whole * unit:.4g}")
    keep_alive()
    with suppress(UsageError):  # twice may be more than the integer holds: then the next try raises
        if parameters.refused_while_armed(before, quantities.changed(before, {name: value})):
            return float(f"{(whole + inwards) * unit:.4g}")
    return value
