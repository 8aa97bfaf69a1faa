"""Measure how many mutants of the step's code the golden vectors kill, of those that any test kills.

    tools/measure_mutants.py            300 mutants; exit code 1 when the vectors miss more than 2 %
    tools/measure_mutants.py --write    and put the figure into docs/explanation/design.md

A mutant is one small change of the C (tests/support/mutants.py). Those that every vector lets pass are given to the
tests of kernels and systems; when these let one pass, too, it counts for nothing: mostly it is equal to the core.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "tests")]

from plumb.proof import golden  # noqa: E402
from support.mutant_judges import Prepared, killer, other_killers  # noqa: E402
from support.mutants import Mutant, Workshop, mutants  # noqa: E402

SEED, COUNT = 2026, 300
MISSED_MAX = 0.02
PAGE = ROOT / "docs/explanation/design.md"


def judge(chosen: Sequence[Mutant], folder: Path) -> tuple[int, dict[Mutant, str | None]]:
    """How many the vectors kill, and what kills the others; what does not compile is left out."""
    vectors = Prepared.all(golden.load(ROOT / "tests/vectors"))
    workshop = Workshop(folder)
    baseline = workshop.library()
    if baseline is None or killer(baseline, vectors) is not None:
        raise SystemExit("the core itself differs from the vectors")
    killed, passed = 0, {}
    for number, mutant in enumerate(chosen):
        library = workshop.library(mutant, f"mutant_{number}")
        if library is not None and killer(library, vectors) is None:
            passed[mutant] = library
        elif library is not None:
            killed += 1
            library.unlink()
    print(f"{killed} are killed by the vectors; the tests try {len(passed)} others", flush=True)
    others = other_killers(list(passed.values()), folder / "report.txt") if passed else {}
    found = {mutant: others[library] for mutant, library in passed.items()}
    for mutant, other in found.items():
        print(f"{mutant}: {other or 'nothing notices it'}", flush=True)
    return killed, found


def written(count: int, killed: int, missed: Sequence[Mutant]) -> str:
    """The figure, as a paragraph of the page."""
    share = 100 * killed / (killed + len(missed))
    places = "; ".join(sorted(f"`{one.file}`: `{one.old.strip()} -> {one.new or 'nothing'}`" for one in missed))
    return (
        f"Of {count} mutants drawn with seed {SEED}, vectors or other tests kill {killed + len(missed)}; the vectors\n"
        f"alone kill {killed} of these ({share:.1f} %).{f' They miss {places}.' if missed else ''}\n"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=COUNT, help="mutants (default: %(default)s)")
    parser.add_argument("--write", action="store_true", help="put the figure into docs/explanation/design.md")
    arguments = parser.parse_args()
    chosen = mutants()
    random.Random(SEED).shuffle(chosen)
    chosen = chosen[: arguments.count]
    with tempfile.TemporaryDirectory(prefix="plumb-mutants-") as folder:
        killed, found = judge(chosen, Path(folder))
    missed = [mutant for mutant, other in found.items() if other]
    text = written(len(chosen), killed, missed)
    print(text, end="")
    if arguments.write:
        part = re.compile(r"(<!-- begin mutants -->\n).*?(<!-- end -->)", re.DOTALL)
        page, places = part.subn(lambda at: at[1] + text + at[2], PAGE.read_text(encoding="utf-8"))
        assert places == 1, PAGE
        PAGE.write_text(page, encoding="utf-8")
    return 0 if len(missed) <= MISSED_MAX * (killed + len(missed)) else 1


if __name__ == "__main__":
    sys.exit(main())
