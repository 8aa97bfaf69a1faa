"""JSON of golden files and of their manifest: integers, text, lists and objects, nothing else, no key twice."""

from __future__ import annotations

import json
from typing import Any, NoReturn


def json_object(data: bytes) -> dict[str, Any]:  # Any: the callers check each value
    """A JSON object without floats, NaN or repeated keys; raises ValueError or RecursionError."""
    try:
        value = json.loads(data.decode(), object_pairs_hook=_unique, parse_float=_no_float, parse_constant=_no_float)
    except (UnicodeDecodeError, json.JSONDecodeError):
        raise ValueError("it is no JSON") from None
    if not isinstance(value, dict):
        raise ValueError("it is no JSON object")
    return value


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key appears twice")
    return found


def _no_float(text: str) -> NoReturn:
    raise ValueError("a number is no integer")


def integer(value: object, low: int, high: int, what: str) -> int:
    """The value when it is an integer in its range; raises ValueError otherwise. True and False are refused."""
    if type(value) is not int or not low <= value <= high:
        raise ValueError(f"{what} is no integer from {low} to {high}")
    return value


def integers(value: object, what: str) -> dict[str, int]:
    """An object of integers that fit into 64 bits; raises ValueError otherwise."""
    if not isinstance(value, dict):
        raise ValueError(f"{what} is no object")
    return {name: integer(number, -(1 << 63), (1 << 64) - 1, f"a number of {what}") for name, number in value.items()}
