"""Whole numbers of the command line, in the forms that people type."""

from __future__ import annotations

import argparse
import re
from decimal import Decimal

_GROUPED = re.compile(r"[-+]?\d{1,3}(?:,\d{3})+", re.ASCII)
_DECIMAL = re.compile(r"[-+]?\d{1,20}(?:\.\d{1,20})?(?:[eE]\+?\d{1,2})?", re.ASCII)


def whole_number(text: str) -> int:
    """1000 of "1000", "1_000", "1,000", "1e3" and "1000.0". Raises ArgumentTypeError for anything else."""
    plain = text.strip()
    plain = plain.replace(",", "") if _GROUPED.fullmatch(plain) else plain
    try:
        return int(plain)
    except ValueError:
        pass
    if _DECIMAL.fullmatch(plain) and (value := Decimal(plain)) == value.to_integral_value():
        return int(value)
    raise argparse.ArgumentTypeError(f"{text!r} is no whole number; write for example 1000, 1_000, 1,000 or 1e3")


def flash_offset(text: str) -> int:
    """Bytes, decimal as for `whole_number` or as 0x2000. Raises ArgumentTypeError for anything else."""
    return int(text, 16) if re.fullmatch(r"0[xX][0-9a-fA-F]{1,8}", text) else whole_number(text)
