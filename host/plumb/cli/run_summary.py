"""What a command that makes a run puts out: --out, --json or text, and its exit code."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from plumb.errors import ExitCode, exit_code_of

if TYPE_CHECKING:
    from plumb.proof.runs import Run


def report(arguments: argparse.Namespace, run: Run, summary: dict[str, object]) -> ExitCode:
    """Write the folder of --out, print the summary, and return the exit code of the verdict."""
    if arguments.out:
        from plumb.proof import run_report

        run_report.write_run(arguments.out, run, summary)
    print(json.dumps(summary) if arguments.json else describe(summary))
    return exit_code_of(run.verdict)


def describe(summary: dict[str, object]) -> str:
    """The summary for a reader: one line a figure."""
    metrics = summary["metrics"]
    assert isinstance(metrics, dict)
    seed = "" if summary["seed"] is None else f"seed {summary['seed']}, "
    lines = [
        f"{summary['system']} {summary['scenario']}, tuning {summary['tuning']}, {summary['loop']} loop, "
        f"{seed}{summary['steps']} steps on {summary['board']}{', live' if 'live' in summary else ''}",
        *(f"  {name:<28} {'nothing to score' if value is None else f'{value:.6g}'}" for name, value in metrics.items()),
    ]
    if "first_divergence" in summary:
        lines.append(f"  first divergence: {summary['first_divergence']}")
    lines.append(str(summary["verdict"]))
    return "\n".join(lines)
