"""Output of a command that makes a run: the files of --out, JSON or text, and the exit code."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from plumb.errors import ExitCode, exit_code_of

if TYPE_CHECKING:
    from plumb.proof.report import Statement, Table
    from plumb.proof.runs import Run


def require_out(arguments: argparse.Namespace) -> None:
    """Raises UsageError before the run where `write` could not write the files of --out after it."""
    if arguments.out:
        from plumb.proof import run_report

        run_report.require_writable(arguments.out)


def report(
    arguments: argparse.Namespace,
    run: Run,
    summary: dict[str, object],
    *,
    verdict: str | None = None,
    more: Sequence[Statement] = (),
) -> ExitCode:
    """Write the folder of --out, print the summary, and return the exit code of the verdict. verdict: where it is about
    more than the run; more: statements in addition to those of the run."""
    files = write(arguments, run, summary, statements=more)
    print(json.dumps(summary) if arguments.json else "\n".join([*describe(run, summary, more), *files]))
    return exit_code_of(verdict or run.verdict)


def write(
    arguments: argparse.Namespace,
    run: Run,
    summary: dict[str, object],
    more: Sequence[Table] = (),
    statements: Sequence[Statement] = (),
) -> list[str]:
    """Write the files of --out; returns a line for each file that a user opens."""
    if not arguments.out:
        return []
    from plumb.proof import run_report

    command = getattr(arguments, "command_line", "")
    page, *others = run_report.write_run(arguments.out, run, summary, more, command=command, statements=statements)
    return [f"report: {page}", f"files: {', '.join(str(path) for path in others)}"]


def describe(run: Run, summary: dict[str, object], more: Sequence[Statement] = ()) -> list[str]:
    """The summary as text: a line for each metric, the statements about bits and accuracy, and the verdict."""
    metrics = summary["metrics"]
    assert isinstance(metrics, dict)
    changed = [change.step for change in run.changes]
    gains = f", gains changed at step {' and '.join(map(str, changed))}" if changed else ""
    seed = "" if summary["seed"] is None else f"seed {summary['seed']}, "
    return [
        f"{summary['system']} {summary['scenario']}, tuning {summary['tuning']}, {summary['loop']} loop, "
        f"{seed}{summary['steps']} steps on {summary['board']}{', live' if 'live' in summary else ''}{gains}",
        *(f"  {name:<28} {'nothing to score' if value is None else f'{value:.6g}'}" for name, value in metrics.items()),
        *(f"{statement}" for statement in [*run.statements(summary), *more]),
        str(summary["verdict"]),
    ]
