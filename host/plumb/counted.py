"""A number of things in a sentence."""

from __future__ import annotations


def counted(number: int, what: str, many: str = "") -> str:
    """The number, with commas from 1,000 on, and the noun in its number: "1 flight", "2 flights". many: the plural of a
    noun that does not take an s."""
    return f"{number:,} {what if number == 1 else many or what + 's'}"
