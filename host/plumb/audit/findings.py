"""What an audit says: one finding a sentence, with its certainty, its number and what mends it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Certainty = Literal["sure", "likely", "unknown"]


@dataclass(frozen=True)
class Finding:
    """kind: one word for the subject, as `gyro-units`; wrong: a fault, and not a property; sentence: with the number
    behind it; mend: what `--mend` takes to undo it, None where nothing does; other: the mend of the second reading of a
    fault that has two; numbers: for JSON."""

    kind: str
    certainty: Certainty
    sentence: str
    wrong: bool = False
    mend: str | None = None
    other: str | None = None
    numbers: Mapping[str, object] = field(default_factory=dict)

    @property
    def sure_fault(self) -> bool:
        return self.wrong and self.certainty == "sure"

    @property
    def line(self) -> str:
        """The finding as one line for people: a fault with its certainty and its mend."""
        if not self.wrong:
            return f"{self.kind}: {self.sentence}" + (" (unknown)" if self.certainty == "unknown" else "")
        by = f" [--mend {self.mend}" + (f", or --mend {self.other}]" if self.other else "]") if self.mend else ""
        return f"{self.kind}: {self.certainty}: {self.sentence}{by}"

    def to_json(self) -> dict[str, object]:
        return {
            "kind": self.kind,
            "certainty": self.certainty,
            "wrong": self.wrong,
            "sentence": self.sentence,
            "mend": self.mend,
            "other_mend": self.other,
            "numbers": dict(self.numbers),
        }


def note(
    kind: str,
    sentence: str,
    certainty: Certainty = "sure",
    *,
    numbers: Mapping[str, object] | None = None,
    **more: object,
) -> Finding:
    """A property, or what cannot be told (`unknown`)."""
    return Finding(kind, certainty, sentence, numbers={**(numbers or {}), **more})


def fault(
    kind: str,
    certainty: Certainty,
    sentence: str,
    mend: str | None = None,
    other: str | None = None,
    *,
    numbers: Mapping[str, object] | None = None,
    **more: object,
) -> Finding:
    return Finding(kind, certainty, sentence, True, mend, other, {**(numbers or {}), **more})
