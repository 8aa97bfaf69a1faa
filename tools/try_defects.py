"""Build the declared defects of tests/defects one at a time, and show that the rows and tests of each notice it.

    tools/try_defects.py                     all of them
    tools/try_defects.py 'keepalive-*' pwm   by name, or by file of tests/defects

Works in a copy of the checkout, build/defects. Exit code 1 when a defect is not noticed, or a row is red without it.
"""

from __future__ import annotations

import argparse
import sys
import time
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from support.defect_tree import CannotBuild, Tree, judged  # noqa: E402
from support.defects import declared  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("name", nargs="*", help="defects, or the files that declare them, with * and ?")
    parser.add_argument("--list", action="store_true", help="list the defects instead")
    parser.add_argument("--folder", default="by-hand", help="subfolder of build/defects to work in")
    arguments = parser.parse_args()
    chosen = [
        defect
        for defect in declared()
        if not arguments.name
        or any(fnmatch(defect.name, name) or fnmatch(Path(defect.source).stem, name) for name in arguments.name)
    ]
    if not chosen:
        parser.error("no defect has such a name")
    if arguments.list:
        for defect in chosen:
            print(f"{defect.name:<40} {Path(defect.source).name:<16} {', '.join(defect.caught_by)}")
        return 0
    missed = 0
    with Tree.opened(ROOT / "build" / "defects" / arguments.folder) as tree:
        for defect in chosen:
            begun_s = time.monotonic()
            try:
                verdicts, wrong = judged(tree, defect)
            except (CannotBuild, RuntimeError, ValueError) as error:
                verdicts, wrong = [], [str(error)]
            missed += bool(wrong)
            print(f"{'MISSED' if wrong else 'caught'} {defect.name} ({time.monotonic() - begun_s:.0f} s)", flush=True)
            for said in verdicts:
                print(f"       {said.name}, image {said.image[:12]}: {'red: ' + said.why if said.red else 'green'}")
            for sentence in wrong:
                print(f"       {sentence}")
    print(f"{len(chosen)} defects, {missed} missed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
