"""The unit of variance of a set of parameters, for systems whose filter has variances in words.

The host chooses it for each set so that the words are as fine as they can be; the filter itself does not use it.
"""

from __future__ import annotations

from plumb.contract.parameters import NOTHING, Context, ControlParams
from plumb.spec import parameters

LSB = "lsb_deg2"


def in_variances(lsb_deg2: float) -> Context:
    """What belongs to words with this unit of variance, in deg^2: the unit, and the parameter that the board's checks
    take it from."""
    return Context({LSB: lsb_deg2}, {parameters.UNIT: _turn2_q56(lsb_deg2)})


def from_turn2_q56(unit: int) -> Context:
    """The same from that parameter; nothing for 0, when it is not known."""
    return in_variances(unit / 2.0**56 * 360.0**2 / 2.0**32) if unit else NOTHING


def lsb_of(params: ControlParams) -> float:
    """The unit of variance in deg^2; 1 when it is not known."""
    return params.context.scales.get(LSB, 1.0)


def variance_turn2_q56(params: ControlParams) -> int:
    """2^32 lsb of variance in turn^2, Q56, for the parameter of that name; 0 if the unit is not known."""
    return _turn2_q56(lsb_of(params))


def _turn2_q56(lsb_deg2: float) -> int:
    unit = round(lsb_deg2 * 2.0**32 / 360.0**2 * 2.0**56)
    return unit if unit < 1 << 32 else 0
