"""Close the loop of a system on the virtual board, without hardware, then check the golden vectors of all systems.

The unmodified flash image runs on a simulated STM32F103. The plant drives the voltages of its ADC pins and follows its
PWM; telemetry arrives over its serial port. Every step is compared with the integer model. Then the golden vectors of
all systems run on the native core, on QEMU if it is installed, and on the virtual board over its serial port and over
CAN. Writes DIR/report.html, DIR/summary.json and DIR/steps.csv.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from plumb.cli import options
from plumb.spec.system_parts import Part

if TYPE_CHECKING:
    from plumb.proof.report import Table
    from plumb.proof.runs import Run


class Demo(Protocol):
    """demo.py of a system: the run that `plumb demo` shows."""

    @property
    def SCENARIO(self) -> str: ...

    @property
    def TUNING(self) -> str: ...

    def errors(self, run: Run, /) -> dict[str, tuple[float, float]]:
        """Estimate -> (rms, largest) error of the tilt in deg."""


DEMO = Part[Demo]("demo", Demo, without="it has no demo", place="judging")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_system_with(parser, DEMO.name, "system of the demo")
    options.add_out(parser, default=Path("out/demo"))
    options.add_image(parser)
    options.add_seed(parser)
    options.add_seconds(parser, "simulated length (default 60)", default=60.0)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb import systems
    from plumb.boards import open_board, qemu
    from plumb.cli.run_summary import require_out, write
    from plumb.errors import exit_code_of
    from plumb.proof import golden
    from plumb.proof.report import Table
    from plumb.proof.scenario_run import RunRequest, perform

    folder = golden.vectors_folder(None)
    name = options.system_with(arguments, DEMO.name)
    part = systems.load(name, DEMO)
    require_out(arguments)
    request = RunRequest(
        name,
        "virtual",
        scenario=part.SCENARIO,
        tuning=part.TUNING,
        seed=arguments.seed,
        seconds=arguments.seconds,
        live=True,
        image=arguments.image,
    )
    without_qemu = qemu.lacking()
    here = ["native", *([] if without_qemu else ["qemu"])]
    boards = [*((one, one, "serial") for one in here), ("virtual", "virtual", "serial")]
    boards.append(("virtual, CAN", "virtual", "can"))
    options.print_default(arguments, name, DEMO.name)
    if without_qemu:
        print(f"without qemu: {without_qemu}", file=sys.stderr)
    cases = golden.cases(folder)
    done = perform(request)
    checks = {}
    for label, spec, link in boards:
        with open_board(spec, link=link, image=arguments.image) as board_:
            checks[label] = golden.check(board_, folder, chosen=cases)

    run, inputs = done.run, done.run.inputs
    errors = part.errors(run)
    verdict = golden.worst_of([run.verdict, *(check.verdict for check in checks.values())])
    summary = done.summary(board="virtual, live ADC", live=None)
    summary |= {"verdict": verdict, "bit_exact": golden.bit_exact(verdict)}
    summary["tilt_error_deg"] = {name: {"rms": rms, "max": worst} for name, (rms, worst) in errors.items()}
    summary["golden"] = {name: check.to_json() for name, check in checks.items()}
    summary["golden_left_out"] = {"qemu": without_qemu} if without_qemu else {}
    tables = [
        Table(
            f"Tilt error against the truth, t >= {inputs.time_s[inputs.scored][0]:g} s",
            ["estimate", "rms", "largest"],
            # further digits change from build to build: the image's timing moves the pulses, which move the plant
            [[name, f"{rms:.2f} deg", f"{worst:.1f} deg"] for name, (rms, worst) in errors.items()],
            "All rows from the same raw counts, taken by the board's ADC in the closed loop.",
        ),
        Table(
            f"Golden vectors of {', '.join(systems.SYSTEMS)}",
            ["board", "vectors", "steps", "mismatches"],
            [
                [name, *(str(check.to_json()[key]) for key in ("vectors", "steps", "mismatches"))]
                for name, check in checks.items()
            ],
            f"Without qemu: {without_qemu}." if without_qemu else "",
            bad_rows=frozenset(i for i, check in enumerate(checks.values()) if check.to_json()["mismatches"]),
        ),
    ]
    files = write(arguments, run, summary, tables)
    if arguments.json:
        print(json.dumps(summary))
    else:
        for table in tables:
            print(render(table))
        print("\n".join(["live run:", *(f"  {one}" for one in run.statements(summary)), verdict, *files]))
    return exit_code_of(verdict)


def render(table: Table) -> str:
    """A report table as text."""
    lines = [list(table.head), *(list(row) for row in table.rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(table.head))]
    body = ["  " + "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines]
    return "\n".join([table.title, *(line.rstrip() for line in body), ""])
