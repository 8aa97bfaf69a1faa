"""The simulated chip without the rest of plumb: any image boots, and nothing of the product is loaded."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "boot_any_image.py"
BELOW = ("checkout", "errors", "extras", "files", "flash", "process_signals")
"""What the chip stands on: image files, errors, signals of the process."""


def run(*arguments: str) -> list[str]:
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_the_example_boots_a_foreign_image(build: Callable[[str], Path]) -> None:
    """hello.c sends a line and lifts PC13; PC14 floats."""
    elf = build("hello")
    said = repr(b"hello\n")
    assert run(str(EXAMPLE), str(elf.with_suffix(".bin")), "PC13") == [said, "PC13 True"]
    assert run(str(EXAMPLE), str(elf), "PC14") == [said, "PC14 None"]


def test_the_example_says_at_which_rate_the_image_sends(build: Callable[[str], Path]) -> None:
    image = str(build("hello").with_suffix(".bin"))
    line, *_ = run(str(EXAMPLE), image, "PC13", "115200")
    baud = re.fullmatch(r"USART1 is set to (\d+) baud, what came is read at 115200: give BAUD", line)
    assert baud is not None
    assert run(str(EXAMPLE), image, "PC13", baud[1]) == [repr(b"hello\n"), "PC13 True"]


def test_the_example_says_that_an_image_sets_up_no_uart(build: Callable[[str], Path]) -> None:
    image = str(build("systick").with_suffix(".bin"))
    assert run(str(EXAMPLE), image, "PC13")[0] == "the program never set up USART1"


def test_the_example_says_why_and_where_a_program_faults(build: Callable[[str], Path]) -> None:
    """udf.c executes udf, and its handler loops; a .bin has no functions to name."""
    elf = build("udf")
    line, *_ = run(str(EXAMPLE), str(elf), "PC13")
    assert re.match(r"HardFault after .* \(UNDEFINSTR\), pc 0x080[0-9A-F]{5} in main \(udf\.c:\d+\) \(lr ", line)
    line, *_ = run(str(EXAMPLE), str(elf.with_suffix(".bin")), "PC13")
    assert re.match(r"HardFault after .* \(UNDEFINSTR\), pc 0x080[0-9A-F]{5} \(lr ", line)


def test_the_example_without_an_image_says_how_it_is_called() -> None:
    done = subprocess.run([sys.executable, str(EXAMPLE)], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "boot_any_image.py firmware.bin PC13" in done.stderr
    assert "Traceback" not in done.stderr


def test_nothing_of_the_product_is_loaded(build: Callable[[str], Path]) -> None:
    program = (
        "import runpy, sys; sys.argv = sys.argv[1:]; runpy.run_path(sys.argv[0]); "
        "print(*sorted(name for name in sys.modules if name.startswith('plumb.')))"
    )
    *_, loaded = run("-c", program, str(EXAMPLE), str(build("hello").with_suffix(".bin")), "PC13")
    foreign = [name for name in loaded.split() if name.split(".")[1] not in (*BELOW, "f103")]
    assert "plumb.f103.machine" in loaded.split()
    assert not foreign
