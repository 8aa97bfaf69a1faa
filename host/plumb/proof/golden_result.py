"""Results of a check of golden vectors: for each vector, and for a board over all of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from plumb.proof.compare import Divergence


def bit_exact(verdict: str) -> bool | None:
    """Whether every compared bit agreed; None where digests were lost or nothing was compared."""
    return {"pass": True, "fail": False}.get(verdict)


@dataclass(frozen=True)
class VectorResult:
    """Result of one golden vector on a board.

    Attributes:
        vector: Name of the vector.
        system: Name of its system.
        steps: Steps of the vector.
        mismatches: Steps whose digest is not the vector's, or is missing.
        first_divergence: The first step and signal that differ; None where none does.
        unverified_from: First step whose answer was lost on the link; None where none was.
        seconds: How long the board took, s.
        board: The board as it was named.
    """

    vector: str
    system: str
    steps: int
    mismatches: int
    first_divergence: Divergence | None = None
    unverified_from: int | None = None
    seconds: float = 0.0
    board: str = ""

    @property
    def bit_exact(self) -> bool | None:
        """Whether every digest is the vector's; None where answers were lost on the link."""
        return bit_exact(self.verdict)

    @property
    def verdict(self) -> str:
        """`pass`, `fail`, or `unverified`: answers were lost on the link, and no other differs."""
        if self.mismatches or self.first_divergence:
            return "fail"
        return "pass" if self.unverified_from is None else "unverified"

    def to_json(self) -> dict[str, object]:
        """A row of `plumb golden check --json`."""
        first = self.first_divergence
        return {
            "vector": self.vector,
            "system": self.system,
            "steps": self.steps,
            "verdict": self.verdict,
            "bit_exact": self.bit_exact,
            "mismatches": self.mismatches,
            "first_divergence": None if first is None else first.as_dict(),
            "unverified_from": self.unverified_from,
        }

    def describe(self) -> str:
        """One line: verdict, vector, steps, and where it first differs."""
        text = f"{self.verdict} {self.vector}: {self.steps} steps"
        if self.verdict != "pass":
            text += f", {self.mismatches} mismatches"
        if self.first_divergence:
            text += f"; first: {self.first_divergence}"
        if self.unverified_from is not None:
            text += f"; unverified from step {self.unverified_from}: answers were lost"
        return text


@dataclass
class Result:
    """One board over all its vectors. unverified_from: first vector and step whose answer was
    lost."""

    vectors: int = 0
    steps: int = 0
    mismatches: int = 0
    first_divergence: Divergence | None = None
    unverified_from: tuple[str, int] | None = None
    rows: list[VectorResult] = field(default_factory=list)

    def add(self, row: VectorResult) -> None:
        self.rows.append(row)
        self.vectors += 1
        self.steps += row.steps
        self.mismatches += row.mismatches
        self.first_divergence = self.first_divergence or row.first_divergence
        if row.unverified_from is not None and self.unverified_from is None:
            self.unverified_from = (row.vector, row.unverified_from)

    @property
    def verdict(self) -> str:
        if self.mismatches or self.first_divergence:
            return "fail"
        return "pass" if self.unverified_from is None and self.vectors else "unverified"

    def to_json(self, rows: bool = False) -> dict[str, object]:
        """rows: with `results`, an object for every vector."""
        first = self.first_divergence
        whole: dict[str, object] = {
            "vectors": self.vectors,
            "steps": self.steps,
            "mismatches": self.mismatches,
            "first_divergence": None if first is None else first.as_dict(),
            "bit_exact": bit_exact(self.verdict),
        }
        return {**whole, "results": [row.to_json() for row in self.rows]} if rows else whole

    def describe(self) -> str:
        text = f"{self.vectors} vectors, {self.steps} steps, {self.mismatches} mismatches"
        if self.first_divergence:
            text += f"; first: {self.first_divergence}"
        if self.unverified_from:
            text += "; unverified from {} step {}: answers were lost".format(*self.unverified_from)
        return text


def verdict_of(results: Iterable[Result]) -> str:
    """The worst verdict of all results."""
    return worst_of([result.verdict for result in results])


def worst_of(verdicts: Sequence[str]) -> str:
    """fail, else unverified, else pass."""
    return next((verdict for verdict in ("fail", "unverified") if verdict in verdicts), "pass")
