"""`attitude` in the columns of blackbox_decode: the rates; it has no pilot and no motors."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.contract.parameters import ControlParams
from plumb.spec.records import Words
from plumb.systems.blackbox import Cells

DEG_PER_Q28 = 360.0 / 2**28


def columns(words: Words, _before: Words, _params: ControlParams, /) -> Mapping[str, Cells]:
    return {f"gyroADC[{axis}]": words[f"rate_turnps_q28_{axis}"] * DEG_PER_Q28 for axis in range(3)}
