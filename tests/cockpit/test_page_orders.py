"""What a page may ask for: whole orders pass, everything else is one sentence."""

from __future__ import annotations

import json

import pytest

from plumb.cockpit.page_orders import MOST_BYTES, Order, parse
from plumb.errors import UsageError


@pytest.mark.parametrize(
    ("said", "order"),
    [
        ({"do": "stop"}, Order("stop", 7)),
        ({"do": "alive", "tick": 9}, Order("alive", 7, tick=9)),
        ({"do": "arm", "number": 3}, Order("arm", 7, number=3)),
        ({"do": "set", "name": "pid.kp", "value": 1}, Order("set", 7, name="pid.kp", value=1.0)),
        ({"do": "record", "on": True}, Order("record", 7, on=True)),
        ({"do": "step_test", "value": -5, "seconds": 2.5}, Order("step_test", 7, value=-5.0, seconds=2.5)),
        ({"do": "stop", "name": {"x": 1}, "more": []}, Order("stop", 7)),
    ],
)
def test_whole_orders(said: dict[str, object], order: Order) -> None:
    assert parse(json.dumps(said), 7) == order


@pytest.mark.parametrize(
    "text",
    [
        "", "stop", "[]", "null", '{"do":', '{"do": 1}', '{"do": ["stop"]}', '{"do": "fly"}', '{"do": "STOP"}',
        "[" * 4000, " " * (MOST_BYTES + 1), '{"do": "setpoint"}', '{"do": "setpoint", "value": "5"}',
        '{"do": "setpoint", "value": true}', '{"do": "setpoint", "value": NaN}', '{"do": "setpoint", "value": 1e300}',
        '{"do": "setpoint", "value": Infinity}', '{"do": "setpoint", "value": 1' + "0" * 400 + "}",
        '{"do": "set", "value": 1}', '{"do": "set", "name": "", "value": 1}', '{"do": "set", "name": 5, "value": 1}',
        '{"do": "describe", "name": "' + "x" * 81 + '"}', '{"do": "record", "on": 1}', '{"do": "alive", "tick": -1}',
        '{"do": "alive", "tick": 1.5}', '{"do": "alive", "tick": true}', '{"do": "arm", "number": 4294967296}',
    ],
)  # fmt: skip
def test_anything_else_is_refused_in_one_sentence(text: str) -> None:
    with pytest.raises(UsageError) as refused:
        parse(text, 7)
    assert "\n" not in str(refused.value)
