"""Write the measured tables and transcripts of README.md and of the systems' pages, between their marks, by running the
commands named there.

usage: .venv/bin/python tools/gen_readme.py [--check] [demo|python|systems|headlines|bench|study|flights|rivals ...]

`systems` computes every figure once, by the command that docs/systems/SYSTEM.md names: its page gets the whole table,
docs/systems/index.md the short ones (`plumb systems --table --short`), README.md one row of each (`headlines`).
docs/explanation/cost.md gets `bench`, docs/systems/quad.md the combinations of the study of its default (`study`).
docs/systems/attitude.md gets `flights`, README.md some rows of that table with the cycles of each step (`rivals`),
and the picture docs/images/flight-errors.svg.
`flights` takes an hour; both are written only when they are named.
Needs the image, the native core and QEMU (`make image native`).
--check writes nothing and exits 1 when a block differs. Rates depend on the machine and stay out.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from plumb.proof import figures
from plumb.proof.figures import Figure
from plumb.systems import with_part

Compared = dict[str, Any]  # Any: JSON of `plumb compare`
ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
ALL_SYSTEMS = ROOT / "docs/systems/index.md"
COST = ROOT / "docs/explanation/cost.md"
FLIGHTS = ROOT / "docs/systems/attitude.md"
FLOWN = "attitude"
ERRORS = ROOT / "docs/images/flight-errors.svg"
SHOWN_FLIGHT = "compare --flights --only sticks --seeds 1 --algorithm attitude --algorithm VQF --algorithm Mahony"
SHOWN_FLIGHTS = {
    "sticks": "sticks to and fro, up to 35 deg",
    "wind-7.7-place": "a place held in wind of 7.7 m/s",
}
"""Rows of README: a flight in which plumb leads, and one that a rival wins."""
EXAMPLE = """\
import numpy as np
import plumb

estimator = plumb.Estimator("attitude", period_s=0.005)  # three axes, 16 bits at 2000 deg/s and 16 g
acc_mps2 = 9.80665 * np.tile([0.0, np.sin(0.1), np.cos(0.1)], (1000, 1))  # at rest, rolled by 0.1 rad
estimate = estimator.run(np.zeros((1000, 3)), acc_mps2)
result = plumb.run("attitude", board="virtual", scenario="hand", seconds=14)
print(f"roll {estimate.roll_rad[-1]:.3f} rad; bit-exact on the flash image: {result.bit_exact}")
"""
COMMANDS = {
    "demo": ["-m", "plumb", "demo", "--out", "out/demo"],
    "python": ["-c", EXAMPLE],
    "bench": ["-m", "plumb", "bench"],
    "study": ["-m", "plumb", "campaign", "examples/studies/quad_default.toml"],
    "flights": ["-m", "plumb", "compare", "--flights", "--seeds", "40", "--json"],
    "cycles": ["tools/measure_published.py", "--json"],
}
NAMES = ["demo", "python", "bench", "study", "systems", "headlines"]
WHEN_NAMED = ["flights", "rivals"]
WITH_FIGURES = with_part(figures.FIGURES.name)
TABLE = re.compile(r"`plumb (systems --table --system \w+(?: --seeds \d+)?)` prints this table")
MACHINE_DEPENDENT = ("native Kalman steps:", "link frames parsed:")


@cache
def answer(name: str) -> str:
    """The output of a command, by its name, or of the arguments of `plumb`."""
    command = COMMANDS.get(name) or ["-m", "plumb", *name.split()]
    done = subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1) or not done.stdout:
        raise SystemExit(f"{name}: {done.stderr.strip()}")
    return done.stdout


def rows() -> list[tuple[str, Figure]]:
    """Every figure, with the name of its system."""
    found = []
    for system in WITH_FIGURES:
        command = TABLE.search((ROOT / "docs/systems" / f"{system}.md").read_text(encoding="utf-8"))
        if command is None:
            raise SystemExit(f"docs/systems/{system}.md does not say which command prints its table")
        found += json.loads(answer(f"{command[1]} --json"))["figures"]
    return [(row["system"], Figure(**{key: row[key] for key in row if key not in ("system", "met")})) for row in found]


def table(page: Path) -> str:
    """The figures for a page: the targets of all systems, or all figures of one system for its own page."""
    if page == ALL_SYSTEMS:
        return figures.render(rows(), short=True)
    return figures.render([(system, row) for system, row in rows() if system == page.stem])


def flights(compared: Compared) -> str:
    """The table of docs/systems/attitude.md: mean of the seeds and worst seed, deg rms, and the stated sigma."""
    names = [one["name"] for one in compared["algorithms"]]
    ours, *rivals = sorted(names, key=lambda name: name != FLOWN)
    lines = [["flight", f"`{ours}`", "its sigma", *rivals], ["---"] * (len(names) + 2)]
    for one in compared["inputs"]:
        means = one["means_deg"]
        cells = {name: f"{means[name]['rmse_deg']:.2f} ({means[name]['worst_rmse_deg']:.2f})" for name in names}
        sigma = f"{means[ours]['sigma_deg']:.2f}"
        lines.append([f"`{one['input']}`", cells[ours], sigma, *(cells[name] for name in rivals)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def draw_errors() -> None:
    """docs/images/flight-errors.svg: the errors of one flight over time."""
    with tempfile.TemporaryDirectory() as folder:
        answer(f"{SHOWN_FLIGHT} --out {folder}")
        ERRORS.write_text((Path(folder) / "errors.svg").read_text(encoding="utf-8"), encoding="utf-8")


def rivals() -> str:
    """README's rows of that table, and the cycles of a step on the chip."""
    page = FLIGHTS.read_text(encoding="utf-8").partition("<!-- flights -->")[2].partition("<!-- end -->")[0]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.strip().splitlines()]
    head, table = cells[0], {row[0].strip("`"): dict(zip(cells[0], row, strict=True)) for row in cells[2:]}
    names = [name for name in head[1:] if name != "its sigma"]
    cycles = json.loads(answer("cycles"))
    lines = [["tilt error in flight, deg rms (worst of 40 seeds)", *names], ["---", *["---:"] * len(names)]]
    lines += [[text, *(table[flight][name] for name in names)] for flight, text in SHOWN_FLIGHTS.items()]
    each = [cycles[name.strip("`")] for name in names]
    lines.append(
        [
            "cycles of a step, mean (worst), by `tools/measure_published.py`",
            *(f"{one['mean']:,.0f} ({one['worst']:,})" for one in each),
        ]
    )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def block(page: Path, name: str) -> str:
    """The text between the marks, indented as Markdown's verbatim text."""
    if name == "flights":
        return f"\n{flights(json.loads(answer(name)))}\n\n"
    if name == "rivals":
        draw_errors()
        return f"\n{rivals()}\n\n"
    if name == "headlines":
        return f"\n{figures.headlines(rows())}\n\n"
    if name == "systems":  # a "-" at the front of a diff is red
        lines = (f"{'-' if line.endswith('MISSED') else ' '} {line}".rstrip() for line in table(page).splitlines())
        return "\n```diff\n" + "\n".join(lines) + "\n```\n\n"
    shown = [line for line in answer(name).rstrip().splitlines() if not line.startswith(MACHINE_DEPENDENT)]
    if name == "study":  # the table of the combinations: indented, behind the pooled figures
        first = next(place for place, line in enumerate(shown) if line.startswith("  scenario "))
        shown = [line.removeprefix("  ") for line in shown[first:] if line.startswith("  ")]
    if name == "python":
        shown = ["```python", *EXAMPLE.rstrip().splitlines(), *(f"# {line}" for line in shown), "```"]
        return "\n" + "\n".join(shown) + "\n\n"
    if name == "demo":  # README has room for what the board reached
        shown = shown[shown.index("live run:") : shown.index("pass") + 1]
    return "\n" + "\n".join(f"    {line}".rstrip() for line in shown) + "\n\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("name", nargs="*", choices=[*NAMES, *WHEN_NAMED, []])
    arguments = parser.parse_args()
    names = arguments.name or NAMES
    pages = {"demo": [README], "python": [README], "bench": [COST], "headlines": [README]}
    pages |= {"study": [ROOT / "docs/systems/quad.md"], "flights": [FLIGHTS], "rivals": [README]}
    pages["systems"] = [ALL_SYSTEMS, *(ROOT / "docs" / "systems" / f"{system}.md" for system in WITH_FIGURES)]
    blocks = [(page, name) for name in names for page in pages[name]]
    stale = False
    for page, name in blocks:
        old = page.read_text(encoding="utf-8")
        begin, mark, rest = old.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not (mark and end):
            raise SystemExit(f"{page.name} has no block '{name}'")
        new = begin + mark + block(page, name) + end + after
        if new != old and arguments.check:
            print(f"{page.name}: '{name}' is not what the command prints; run tools/gen_readme.py")
            stale = True
        elif new != old:
            page.write_text(new, encoding="utf-8")
    return int(stale)


if __name__ == "__main__":
    sys.exit(main())
