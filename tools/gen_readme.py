"""Write the measured tables and transcripts of README.md and of the systems' pages, between their marks, by running the
commands named there.

usage: .venv/bin/python tools/gen_readme.py [--check] [demo|python|systems|headlines|bench|study ...]

`systems` computes every figure once, by the command that docs/systems/SYSTEM.md names: its page gets the whole table,
docs/systems/index.md the short ones (`plumb systems --table --short`), README.md one row of each (`headlines`).
docs/explanation/cost.md gets `bench`, docs/systems/quad.md the combinations of the study of its default (`study`).
Needs the image, the native core and QEMU (`make image native`).
--check writes nothing and exits 1 when a block differs. Rates depend on the machine and stay out.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

from plumb.proof import figures
from plumb.proof.figures import Figure
from plumb.systems import with_part

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
ALL_SYSTEMS = ROOT / "docs/systems/index.md"
COST = ROOT / "docs/explanation/cost.md"
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
}
NAMES = [*COMMANDS, "systems", "headlines"]
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


def block(page: Path, name: str) -> str:
    """The text between the marks, indented as Markdown's verbatim text."""
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
    if name == "demo":  # README has room for what the board reached; the table of the vectors is left out
        paragraphs = "\n".join(shown).split("\n\n")
        shown = "\n\n".join(part for part in paragraphs if not part.startswith("Golden vectors")).splitlines()
    return "\n" + "\n".join(f"    {line}".rstrip() for line in shown) + "\n\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("name", nargs="*", choices=[*NAMES, []])
    arguments = parser.parse_args()
    names = arguments.name or NAMES
    pages = {"demo": [README], "python": [README], "bench": [COST], "headlines": [README]}
    pages["study"] = [ROOT / "docs/systems/quad.md"]
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
