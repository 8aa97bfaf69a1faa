"""A check of golden vectors on several boards, and its reports as files: JUnit XML and a page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from plumb.boards.contract import StepBoard
from plumb.errors import LinkError, UsageError
from plumb.files import whole_files
from plumb.proof import golden
from plumb.proof.golden_junit import junit
from plumb.proof.golden_page import page
from plumb.proof.golden_result import Result, bit_exact, verdict_of
from plumb.proof.golden_window import Window, window
from plumb.proof.run_identity import identity, part_of, rows

PLOTS_MAX = 12
"""Most plots of a board: for each one the board runs the vector once more."""
ADVICE = "choose another file for the report"


@dataclass
class Checks:
    """results: by board. windows: around first divergences. trouble: why the last board's check ended early. parts:
    identity of the boards that ran the vectors, by board, as from `run_identity.part_of`."""

    results: dict[str, Result] = field(default_factory=dict)
    parts: dict[str, dict[str, object]] = field(default_factory=dict)
    windows: list[Window] = field(default_factory=list)
    trouble: LinkError | None = None

    @property
    def verdict(self) -> str:
        return "unverified" if self.trouble and self._agreed() else verdict_of(self.results.values())

    def _agreed(self) -> bool:
        return not any(result.mismatches for result in self.results.values())

    @property
    def errors(self) -> dict[str, str]:
        """Board -> why its check ended early."""
        return {list(self.results)[-1]: str(self.trouble)} if self.trouble else {}

    def to_json(self) -> dict[str, object]:
        """accuracy: null, since golden vectors have no truth to be compared with."""
        return {
            "verdict": self.verdict,
            "bit_exact": bit_exact(self.verdict),
            "accuracy": None,
            "boards": {board: result.to_json(rows=True) for board, result in self.results.items()},
        }


def check_boards(
    open_board: Callable[[str], StepBoard],
    boards: Iterable[str],
    cases: Sequence[golden.Case],
    *,
    windows: bool = False,
) -> Checks:
    """Every board runs the cases that it supports. windows: also gather the steps around each first divergence.

    Raises UsageError. A LinkError ends the check: it is the `trouble`, and the results until then are kept.
    """
    checks = Checks()
    by_name = {case.vector.name: case.vector for case in cases}
    for name in boards:
        result = checks.results[name] = Result()
        try:
            with open_board(name) as board:
                checks.parts[name] = part_of(board)
                if not golden.cases_for(board.name, cases):
                    raise UsageError(
                        f"{name} takes only vectors that the recipe marks on_link; choose others with --vector"
                    )
                plotted = 0
                for row in golden.check_each(board, name, cases):
                    result.add(row)
                    if windows and row.verdict == "fail" and plotted < PLOTS_MAX:
                        shown = window(board, name, by_name[row.vector], row)
                        checks.windows += [shown] if shown else []
                        plotted += 1
        except LinkError as error:
            checks.trouble = error
            break
    return checks


def require_places(paths: Iterable[Path]) -> None:
    """Raises UsageError for a report that could not be written, before a board runs."""
    named = list(paths)
    whole_files.require_different(named, ADVICE)
    for path in named:
        whole_files.require_writable(path, ADVICE)


def write_reports(checks: Checks, junit_file: Path | None, page_file: Path | None, command: str = "") -> None:
    """Write both files completely, or none; None: this report was not requested. command: the command line, for the
    page."""
    files: dict[Path, str | bytes] = {}
    if junit_file:
        files[junit_file] = junit(checks.results, checks.errors)
    if page_file:
        made = rows({name: value for name, value in identity({}, None, command).items() if name != "part"})
        files[page_file] = page(checks.results, checks.errors, checks.windows, checks.verdict, checks.parts, made)
    if files:
        whole_files.write_whole(files, ADVICE)
