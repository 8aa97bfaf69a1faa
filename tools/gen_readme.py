"""Writes the measured tables and transcripts of README.md, between their marks, by running the commands named there.

usage: .venv/bin/python tools/gen_readme.py [--check] [demo|python|systems|bench ...]

Needs the image, the native core and QEMU (`make image native`). --check writes nothing and exits 1 when a block
differs. Rates depend on the machine and stay out.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
EXAMPLE = """\
import numpy as np
from plumb import native, quantise
from plumb.systems import quad

params = quantise.quantise(quad.TUNINGS["adaptive"])
scenario = quad.scenario("motion", seed=7)
words = native.run_control(params, scenario.counts(), scenario.setpoint())
error_deg = words["tilt_turn_q32"] * (360 / 2**32) - scenario.tilt_deg()
print(f"{np.sqrt(np.mean(error_deg[500:] ** 2)):.3f} deg rms")
"""
COMMANDS = {
    "demo": ["-m", "plumb", "demo", "--out", "out/demo"],
    "python": ["-c", EXAMPLE],
    "systems": ["-m", "plumb", "systems", "--table"],
    "bench": ["-m", "plumb", "bench"],
}
MACHINE_DEPENDENT = ("native Kalman steps:", "link frames parsed:")


def block(name: str) -> str:
    """What stands between the marks: the command's output, indented as Markdown wants verbatim text."""
    answer = subprocess.run([sys.executable, *COMMANDS[name]], cwd=ROOT, capture_output=True, text=True, check=False)
    if answer.returncode not in (0, 1):
        raise SystemExit(f"{name}: {answer.stderr.strip()}")
    shown = [line for line in answer.stdout.rstrip().splitlines() if not line.startswith(MACHINE_DEPENDENT)]
    if name == "python":
        shown = [*EXAMPLE.rstrip().splitlines(), *(f"# {line}" for line in shown)]
    if name == "systems":  # a "-" at the front of a diff is red
        shown = [f"{'-' if line.endswith('MISSED') else ' '} {line}".rstrip() for line in shown]
        return "\n```diff\n" + "\n".join(shown) + "\n```\n\n"
    return "\n" + "\n".join(f"    {line}".rstrip() for line in shown) + "\n\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("name", nargs="*", choices=[*COMMANDS, []])
    arguments = parser.parse_args()
    old = text = README.read_text(encoding="utf-8")
    for name in arguments.name or COMMANDS:
        begin, mark, rest = text.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not (mark and end):
            raise SystemExit(f"README.md has no block '{name}'")
        text = begin + mark + block(name) + end + after
    if arguments.check:
        if text != old:
            print("README.md is not what the commands print; run tools/gen_readme.py")
        return int(text != old)
    README.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
