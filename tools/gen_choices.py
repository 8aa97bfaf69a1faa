#!/usr/bin/env python3
"""Accuracy against cycles: measure the choices of the core and their alternatives, and draw them.

usage: .venv/bin/python tools/gen_choices.py [--check [--kernels]]

Kernels (atan2, reciprocal, their word lengths) are compiled from tools/choices/choices.c with the flags of the core and
counted as `plumb bench` counts; their error is that of the very same Arm code. Estimators and periods have the worst
step on the image, and the error of 40 runs of a campaign. Writes docs/explanation/choices.md between its marks, and
docs/images/choices/*.svg. --check writes nothing and exits 1 when
a line of the page differs; --kernels measures the kernels alone. Needs `make image libraries`.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fit_angle import atan_over_t, remez  # type: ignore[import-not-found]
from plumb.analyses.comparison import motions
from plumb.analyses.comparison.contenders import COMPARE, contenders
from plumb.analyses.comparison.samples import SIXTEEN_BITS, sampled
from plumb.analyses.comparison.table import compare
from plumb.bench import bench
from plumb.bench.instruction_counter import Counter, Image
from plumb.campaign import study
from plumb.campaign.batch import run_batch
from plumb.proof import scenario_run, xy_plot
from plumb.proof.report import ESTIMATE, SECOND
from plumb.proof.xy_plot import Axis, Curve, XyPlot
from plumb.spec.arrays import FloatArray
from plumb.systems import default_for, load, with_part

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURES = ROOT / "docs/explanation/choices.md", ROOT / "docs/images/choices"
SOURCE = ROOT / "tools/choices/choices.c"
FLAGS = re.search(r"plumb_core PRIVATE (-O2.*?)\)", (ROOT / "firmware/ports/stm32f103/image.cmake").read_text(), re.S)
ANGLES, DIVISORS = 3000, 3000
HZ = 72e6
RUNS, STEPS = 40, 300
AXIS, THREE_AXES = default_for("demo"), with_part(COMPARE.name)
"""Systems whose estimators are shown: on one axis, that of the demo; and on three, those that `plumb compare` has."""
ROOM = 1.6
"""Of the error's axis beyond the points, as a factor: room for their names."""
PERIODS_US = (5000, 10_000, 20_000, 40_000)


@dataclass(frozen=True)
class Choice:
    """A line of the table. cycles: of one call or step, worst case; load: share of the chip at 72 MHz, %, of those
    that run every period; error: in the unit of its group; shipped: the core has it."""

    group: str
    name: str
    cycles: int
    error: float
    unit: str
    load: float | None = None
    shipped: bool = False

    def line(self) -> list[str]:
        load = "" if self.load is None else f"{self.load:.2f}"
        return [self.group, self.name, str(self.cycles), load, f"{self.error:.2g} {self.unit}", "*" * self.shipped]


def built(folder: Path) -> Image:
    """The alternatives as Arm code, with the flags of the core."""
    assert FLAGS is not None
    (folder / "terms.h").write_text("\n".join(tables()) + "\n", encoding="utf-8")
    inside = [f"-I{ROOT / 'firmware' / part}" for part in ("", "core", "include")]
    core = [ROOT / "firmware/core/angle.c", ROOT / "firmware/core/fixed.c"]
    words = ["arm-none-eabi-gcc", "-mcpu=cortex-m3", "-mthumb", "-g", "-std=c11", *FLAGS.group(1).split()]
    words += ["-nostartfiles", "-Wl,-Ttext=0x08000000", "-Wl,-e,atan2_shipped", f"-I{folder}", *inside]
    subprocess.run([*words, "-o", str(folder / "choices.elf"), str(SOURCE), *map(str, core)], check=True)
    return Image(folder / "choices.elf")


def tables() -> Iterator[str]:
    """Coefficients of the polynomials, by the fit of the core's own, and the angles of CORDIC."""
    for terms in (2, 3, 4, 5, 6):
        fitted = remez(atan_over_t, np.sqrt, terms)
        yield _array("int32_t", f"ATAN_Q33_{terms}", [round(float(c) * 2**33) for c in fitted])
        if terms == 5:
            yield _array("int32_t", "ATAN_Q17_5", [round(float(c) * 2**17) for c in fitted])
    angles = np.arctan(0.5 ** np.arange(24)) / (2.0 * np.pi)
    yield _array("uint32_t", "CORDIC_Q32", [round(float(one) * 2**32) for one in angles])


def _array(kind: str, name: str, numbers: Sequence[int]) -> str:
    return f"static const {kind} {name}[{len(numbers)}] = {{{', '.join(map(str, numbers))}}};"


def kernels(image: Image) -> Iterator[Choice]:
    """Every function of choices.c over the same arguments."""
    rng = np.random.default_rng(1)
    turn = rng.uniform(-np.pi, np.pi, ANGLES)
    size = 2.0 ** rng.uniform(20.0, 29.0, ANGLES)
    vectors = np.rint(np.stack([size * np.sin(turn), size * np.cos(turn)])).astype(np.int64)
    true_deg = np.degrees(np.arctan2(*vectors.astype(np.float64)))

    def angle_deg(found: FloatArray) -> float:
        return float(np.max(np.abs((found * (360.0 / 2.0**32) - true_deg + 180.0) % 360.0 - 180.0)))

    for name, symbol in (
        ("polynomial of 8 terms, 32 bits", "atan2_shipped"),
        *((f"polynomial of {terms} terms, 32 bits", f"atan2_{terms}") for terms in (2, 3, 4, 5, 6)),
        ("polynomial of 5 terms, 16 bits", "atan2_short"),
        *((f"CORDIC, {turns} turns", f"cordic_{turns}") for turns in (8, 16, 24)),
    ):
        cycles, error = _over(image, symbol, vectors.T.tolist(), angle_deg)
        yield Choice("atan2", name, cycles, error, "deg", shipped=symbol == "atan2_shipped")
    divisors = rng.integers(1 << 30, 1 << 31, DIVISORS)
    exact = 2.0**61 / divisors.astype(np.float64)

    def relative(found: FloatArray) -> float:
        return float(np.max(np.abs((found % 2.0**32) / exact - 1.0)))

    for name, symbol in (
        ("16 bits by UDIV, one Newton step", "reciprocal_shipped"),
        ("16 bits by UDIV alone", "reciprocal_division"),
        *((f"a line, {steps} Newton steps", f"reciprocal_newton_{steps}") for steps in (2, 3, 4)),
        ("64-bit division of the compiler", "reciprocal_library"),
    ):
        cycles, error = _over(image, symbol, [[one] for one in divisors.tolist()], relative)
        yield Choice("reciprocal", name, cycles, error, "of itself", shipped=symbol == "reciprocal_shipped")


def _over(
    image: Image, symbol: str, arguments: Sequence[Sequence[int]], error: Callable[[FloatArray], float]
) -> tuple[int, float]:
    """Worst cycles of a function over its arguments, and the error of its results."""
    counter = Counter(image)
    calls = [counter.call(symbol, *row) for row in arguments]
    found = np.array([call.result for call in calls], np.uint32).view(np.int32).astype(np.float64)
    return max(call.cost.cycles for call in calls), error(found)


def worst_step(image: Image, driven: Callable[[bench.StepDriver], object]) -> int:
    """Worst cycles of control_step on the image, over what a function runs."""
    counter = Counter(image, ["control_step"])
    driven(bench.StepDriver(counter))
    return counter.profiles["control_step"].cycles_max


def one_axis(image: Image) -> Iterator[Choice]:
    """Tunings and periods of AXIS on its default scenario."""
    system = load(AXIS)
    at = {"period": [(system.DEFAULT_TUNING, one) for one in PERIODS_US]}
    usual = system.TUNINGS[system.DEFAULT_TUNING].period_us
    at["filter"] = [(name, usual) for name in system.TUNINGS if system.TUNINGS[name].period_us == usual]
    for group, entries in at.items():
        for tuning, period_us in entries:
            declared = study.from_table(
                {
                    "system": AXIS, "runs": RUNS, "seconds": 60, "open_loop": True, "tuning": tuning,
                    "vary": {"tuning.period_us": [period_us]},
                }
            )  # fmt: skip
            ran = run_batch(declared, range(RUNS))
            error = float(np.mean(np.array(ran.metrics["angle_rmse_deg"], np.float64)))
            drawn = scenario_run.draw(declared.request(0))
            counts, setpoint = drawn.scenario.counts()[:STEPS], drawn.scenario.setpoint()[:STEPS]
            cycles = worst_step(image, lambda driver: driver.run(drawn.params, counts, setpoint))  # noqa: B023
            name = f"{AXIS}, {tuning}, every {period_us / 1000:g} ms"
            shipped = (tuning, period_us) == (system.DEFAULT_TUNING, usual)
            yield Choice(group, name, cycles, error, "deg rms", 100.0 * cycles / (period_us * 1e-6 * HZ), shipped)


def three_axes(image: Image) -> Iterator[Choice]:
    """Estimators of the vertical on the prescribed motions of `plumb compare --motions`."""
    seeds = range(motions.FIRST_SEED, motions.FIRST_SEED + 2)
    compared = compare(
        [motions.of_motion(name, seeds) for name in motions.MOTIONS], contenders(THREE_AXES), lambda: None
    )
    name = next(iter(motions.MOTIONS))
    samples = sampled(motions.prescribed(name, motions.FIRST_SEED), SIXTEEN_BITS, 1)
    for system in THREE_AXES:
        part, means = load(system, COMPARE), [one.means(system) for one in compared]
        inputs, params = part.inputs(samples), part.params(samples)
        cycles = worst_step(
            image,
            lambda driver: driver.run(params, inputs.raw[:STEPS], inputs.setpoint[:STEPS]),  # noqa: B023
        )
        error = float(np.mean([one.rmse_deg for one in means if one is not None]))
        load_pc = 100.0 * cycles / (samples.period_us * 1e-6 * HZ)
        yield Choice("estimator", f"{system}, every {samples.period_us / 1000:g} ms", cycles, error, "deg rms", load_pc)


def measured(*, kernels_alone: bool) -> list[Choice]:
    with tempfile.TemporaryDirectory() as folder:
        found = list(kernels(built(Path(folder))))
    if kernels_alone:
        return found
    image = Image(bench.find_image())
    return [*found, *one_axis(image), *three_axes(image)]


def table(found: Sequence[Choice]) -> str:
    rows = [["", "choice", "cycles", "% of 72 MHz", "error", "shipped"], *(one.line() for one in found)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return "\n".join("    " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows)


def drawings(found: Sequence[Choice]) -> dict[str, str]:
    """File name -> SVG, a picture of each group: cycles to the right, error upwards; below and left is better."""
    pictures = {}
    for group in dict.fromkeys(one.group for one in found):
        own = [one for one in found if one.group == group]
        loaded = all(one.load is not None for one in own)
        x = [one.load if one.load is not None else float(one.cycles) for one in own]
        curves = []
        for shipped, colour in ((False, SECOND), (True, ESTIMATE)):
            part = [(a, one) for a, one in zip(x, own, strict=True) if one.shipped is shipped]
            label = "shipped" if shipped else "alternatives"
            at, y = np.array([a for a, _ in part]), np.array([one.error for _, one in part])
            names = [f"{one.name} (shipped)" if shipped else one.name for _, one in part]
            curves += [Curve(label, at, y, colour, points=True, names=names)] if part else []
        spread = max(x) > 2.0 * min(x)
        across = Axis("share of 72 MHz (%)" if loaded else "cycles", log=loaded and spread, low=None if spread else 0.0)
        errors = [one.error for one in own]
        upwards = Axis(f"error ({own[0].unit})", log=True, low=min(errors) / ROOM, high=max(errors) * ROOM)
        plot = XyPlot(f"{group}: error against cycles", across, upwards, curves)
        pictures[f"{group}.svg"] = xy_plot.plot_svg(plot)
    return pictures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--kernels", action="store_true")
    arguments = parser.parse_args()
    if arguments.kernels and not arguments.check:
        parser.error("--kernels goes with --check: the page has all lines")
    found = measured(kernels_alone=arguments.kernels)
    text = PAGE.read_text(encoding="utf-8")
    if arguments.check:
        kept = [line.split() for line in text.splitlines()]
        stale = [line for line in table(found).splitlines() if line.split() not in kept]
        print(
            "\n".join([f"{PAGE.relative_to(ROOT)} differs: run tools/gen_choices.py", *stale] if stale else ["fresh"])
        )
        return int(bool(stale))
    before, _, rest = text.partition("<!-- choices -->\n")
    new = f"{before}<!-- choices -->\n\n{table(found)}\n\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    PAGE.write_text(new, encoding="utf-8")
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name, drawn in drawings(found).items():
        (PICTURES / name).write_text(drawn, encoding="utf-8")
    print(table(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
