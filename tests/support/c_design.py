"""The designs in C (firmware/design), called with the tunings of Python."""

from __future__ import annotations

import ctypes
from dataclasses import Field, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from plumb.spec import parameters

LIBRARY = Path(__file__).resolve().parents[2] / "build" / "native" / "tests" / "c" / "libdesign_functions.so"

CHOICES = {
    "tilt": ("arcsine", "atan2"),
    "rate": ("previous", "current", "trapezium"),
    "rates": ("body", "euler"),
    "layer": ("data", "attitude", "printed"),
}


class Answer(NamedTuple):
    """What a design gives. error: plumb_design_error_t; least, most: of the refused field; words: of the whole control
    part, by name; {} when refused."""

    error: int
    field: str
    lsb_deg2: float
    least: float
    most: float
    words: dict[str, int]


class _Design(ctypes.Structure):
    _fields_ = [
        ("error", ctypes.c_int),
        ("field", ctypes.c_char_p),
        ("asked", ctypes.c_double),
        ("least", ctypes.c_double),
        ("most", ctypes.c_double),
        ("lsb_deg2", ctypes.c_double),
    ]


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    loaded = ctypes.CDLL(str(LIBRARY))
    loaded.plumb_design_share.restype = ctypes.c_double
    loaded.plumb_design_share.argtypes = [ctypes.c_double]
    return loaded


def _members(tuning: Any) -> list[tuple[Field[Any], Any]]:
    pairs = [(entry, getattr(tuning, entry.name)) for entry in fields(tuning)]
    return [(entry, value) for entry, value in pairs if entry.name != "exact_period_s"]


@lru_cache(maxsize=64)
def _layout(name: str, shape: tuple[tuple[str, Any], ...]) -> type[ctypes.Structure]:
    return type(name, (ctypes.Structure,), {"_fields_": list(shape)})


def structure(tuning: Any) -> ctypes.Structure:
    """The C struct of a tuning: its members are declared in the order of the dataclass."""
    shape: list[tuple[str, Any]] = []
    values: list[Any] = []
    for entry, value in _members(tuning):
        if is_dataclass(value):
            inner = structure(value)
            shape.append((entry.name, type(inner)))
            values.append(inner)
        elif entry.type in ("float", float):
            shape.append((entry.name, ctypes.c_double))
            values.append(float(value))
        else:
            shape.append((entry.name, ctypes.c_int32))
            choice = CHOICES.get(entry.name)
            values.append(choice.index(value) if choice and value in choice else -1 if choice else int(value))
    return _layout(type(tuning).__name__, tuple(shape))(*values)


def constant(tuning: Any, name: str) -> bytes:
    """The bytes of PLUMB_<SYSTEM>_TUNING_<NAME> in the library, as long as the tuning's struct."""
    size = ctypes.sizeof(structure(tuning))
    of_c = f"PLUMB_{tuning.system}_TUNING_{name.replace('-', '_')}".upper()
    return bytes((ctypes.c_char * size).in_dll(library(), of_c))


def design(tuning: Any) -> Answer:
    """plumb_<system>_design."""
    rows = [row for row in parameters.table() if row.owner == "control"]
    words = (ctypes.c_uint32 * len(rows))()
    function = getattr(library(), f"plumb_{tuning.system}_design")
    function.restype = _Design
    settings = structure(tuning)
    answer = function(ctypes.byref(settings), words)
    made = {row.name: row.from_word(word) for row, word in zip(rows, words, strict=True)}
    field = (answer.field or b"").decode()
    return Answer(answer.error, field, answer.lsb_deg2, answer.least, answer.most, {} if answer.error else made)
