#!/usr/bin/env python3
"""Cycles of a step of VQF, BasicVQF and Mahony on the Cortex-M3 of the STM32F103, and of `attitude`, over one motion.

usage: .venv/bin/python tools/measure_published.py [--seconds S] [--json]

The C++ of the package vqf, in single precision, and our own lines of Mahony (tools/published/steps.cpp) are compiled
with the options of the core and counted as `plumb bench` counts, at zero wait states; the chip has no FPU, so that the
compiler's library computes. Needs the extra compare, libstdc++-arm-none-eabi-newlib and `make image`.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from plumb import systems
from plumb.analyses.comparison import motions
from plumb.analyses.comparison.contenders import COMPARE
from plumb.analyses.comparison.samples import SIXTEEN_BITS, Samples, sampled
from plumb.bench import bench
from plumb.bench.instruction_counter import Counter, Image
from plumb.errors import UsageError

SOURCE = Path(__file__).resolve().parent / "published/steps.cpp"
FLAGS = "-mcpu=cortex-m3 -mthumb -g -O2 -ffunction-sections -fno-exceptions -fno-rtti -DNDEBUG -DVQF_SINGLE_PRECISION"
LINK = (
    "-nostartfiles --specs=nano.specs --specs=nosys.specs -Wl,--gc-sections -Wl,-Ttext=0x08000000 -Wl,-Tbss=0x20000000"
)
STEPS = {"VQF": "vqf_step", "BasicVQF": "basicvqf_step", "Mahony": "mahony_step"}
MOTION = next(iter(motions.MOTIONS))
SECONDS = 5.0


def built(folder: Path) -> Image:
    """The steps as Arm code. Raises UsageError without the package or the compiler's C++ library."""
    spec = importlib.util.find_spec("vqf")
    if spec is None or spec.origin is None:
        raise UsageError("the package vqf is not installed: pip install -e '.[compare]'")
    code, elf = Path(spec.origin).parent / "cpp", folder / "steps.elf"
    sources = [SOURCE, code / "vqf.cpp", code / "basicvqf.cpp"]
    roots = [f"-Wl,-u,{symbol}" for symbol in ("begin", "mahony_quaternion", *STEPS.values())]
    words = ["arm-none-eabi-g++", *FLAGS.split(), *LINK.split(), *roots, "-Wl,-e,begin", f"-I{code}"]
    done = subprocess.run([*words, *map(str, sources), "-o", str(elf)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise UsageError(f"the steps do not compile: {done.stderr.strip().splitlines()[-1]}")
    return Image(elf)


def published(image: Image, samples: Samples) -> dict[str, tuple[float, int]]:
    """Mean and worst cycles of a step of each published filter over the samples."""
    counter = Counter(image, list(STEPS.values()))
    counter.call("begin", samples.period_us)
    gyr = np.asarray(samples.gyr_radps, "<f4")
    acc = np.asarray(samples.acc_mps2, "<f4")
    at = counter.place(bytes(24))
    for rates, accelerations in zip(gyr, acc, strict=True):
        counter.write(at, rates.tobytes() + accelerations.tobytes())
        for symbol in STEPS.values():
            counter.call(symbol, at, at + 12)
    return {name: _mean_and_worst(counter, symbol) for name, symbol in STEPS.items()}


def ours(samples: Samples, name: str) -> tuple[float, int]:
    """Mean and worst cycles of control_step of a system of plumb over the same samples."""
    part = systems.load(name, COMPARE)
    counter = Counter(Image(bench.find_image()), ["control_step"])
    inputs = part.inputs(samples)
    bench.StepDriver(counter).run(part.params(samples), inputs.raw, inputs.setpoint)
    return _mean_and_worst(counter, "control_step")


def _mean_and_worst(counter: Counter, symbol: str) -> tuple[float, int]:
    profile = counter.profiles[symbol]
    return profile.cycles_sum / profile.calls, profile.cycles_max


def measured(seconds: float = SECONDS) -> dict[str, tuple[float, int]]:
    """Mean and worst cycles by name, those of plumb first."""
    samples = sampled(motions.prescribed(MOTION, motions.FIRST_SEED), SIXTEEN_BITS, 1).first(
        round(seconds / motions.PERIOD_S)
    )
    with tempfile.TemporaryDirectory() as folder:
        rivals = published(built(Path(folder)), samples)
    return {**{name: ours(samples, name) for name in systems.with_part(COMPARE.name)}, **rivals}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    try:
        found = measured(arguments.seconds)
    except UsageError as error:
        parser.exit(2, f"{error}\n")
    if arguments.json:
        print(json.dumps({name: {"mean": round(mean), "worst": worst} for name, (mean, worst) in found.items()}))
        return 0
    for name, (mean, worst) in found.items():
        print(f"{name:<10}{mean:>10,.0f} cycles a step in the mean, {worst:>8,} in the worst")
    return 0


if __name__ == "__main__":
    sys.exit(main())
