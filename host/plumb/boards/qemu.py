"""The C core as code for a Cortex-M under QEMU: reads its inputs from a file, writes every step's words and digest to a
file.

firmware/ports/qemu/main.c describes the file formats. Each run is a QEMU process of its own, which outlives neither the
call nor this process.
"""

from __future__ import annotations

import ctypes
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plumb.boards.contract import Answer, RawCounts, Setpoints, StepBoard, Stepper
from plumb.checkout import CHECKOUT
from plumb.contract.run_fixed import check_inputs, parts_of
from plumb.errors import LinkError, UsageError
from plumb.spec import dbc, images
from plumb.spec.records import RECORDS, Words
from plumb.systems.tasks import Task

if TYPE_CHECKING:
    from plumb.contract.parameters import Changes, ControlParams

PROGRAM = "qemu-system-arm"
MACHINES = {"m0": "microbit", "m3": "mps2-an385", "m4": "mps2-an386", "m7": "mps2-an500"}
"""QEMU's name of a machine with each core. The Cortex-M3 runs the core as the flash image has it, the others the same
sources compiled for them."""
DEFAULT_CORE = "m3"
IMAGES, WHOLE = Path("build/stm32f103"), Path("build/qemu")
"""Programs of the systems of `all`, and of every system, where `all` leaves one out."""
INPUT = "plumb-in.bin"
MAGIC_IN = 0x49424C50
MAGIC_OUT = 0x4F424C50
SAMPLE_DTYPE = np.dtype([("raw", "<i2", dbc.inputs_most()), ("setpoint", "<i4")], align=True)
"""A sample as the image reads it: room for the inputs of any declared system."""
START_UP_S = 30.0
"""Time limit of a run, plus 1 ms for every step: about a hundred times the usual time."""
_EXIT_REASONS = {
    10: "it could not read its input",
    11: "it was built for another parameter layout; build the image again",
    12: "it refused the parameters",
    13: "it could not write its output",
    14: "it took a processor fault",
}


def input_file(params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> bytes:
    """The input of the program: each part of the run with the parameter words that hold in it, then its samples."""
    samples = np.zeros(len(raw), SAMPLE_DTYPE)
    inputs, samples["setpoint"] = check_inputs(params.system, raw, setpoint)
    samples["raw"][:, : inputs.shape[1]] = inputs
    given = [struct.pack("<3I", MAGIC_IN, len(params.words()), 1 + len(changes))]
    for part, now in parts_of(params, changes, len(raw)):
        words = [word & 0xFFFF_FFFF for word in now.words()]
        given += [struct.pack(f"<I{len(words)}I", part.stop - part.start, *words), samples[part].tobytes()]
    return b"".join(given)


def image_name(core: str = DEFAULT_CORE) -> str:
    return "plumb_qemu.elf" if core == DEFAULT_CORE else f"plumb_qemu_{core}.elf"


def _find_image(core: str, builds: Path = IMAGES) -> Path:
    image = builds / image_name(core)
    for folder in (Path.cwd(), CHECKOUT):
        if (folder / image).is_file():
            return (folder / image).resolve()
    raise UsageError(f"there is no {image}; build it with make image in a checkout of plumb, and run plumb from there")


def lacking() -> str:
    """The program or image that the board `qemu` lacks on this machine, as a clause; '' when it can run."""
    if shutil.which(PROGRAM) is None:
        return f"{PROGRAM} is not installed"
    try:
        _find_image(DEFAULT_CORE)
    except UsageError:
        return f"there is no {IMAGES / image_name()} here, which a checkout builds"
    return ""


def _die_with_parent() -> None:
    """Runs in the child before QEMU starts: makes Linux kill QEMU when this process ends."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def _run(command: list[str], folder: Path, limit_s: float) -> int:
    """Run QEMU and return its exit code; after a time-out, Ctrl-C or any other exception QEMU is killed and reaped."""
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C in a terminal reaches this process only
        preexec_fn=_die_with_parent if sys.platform == "linux" else None,
    )
    try:
        _, complaint = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise LinkError(f"{PROGRAM} did not finish within {limit_s:.0f} s and was stopped; run it again") from None
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()
    if process.returncode != 0 and process.returncode not in _EXIT_REASONS:
        said = complaint.decode(errors="replace").strip().splitlines()
        raise LinkError(f"{PROGRAM} ended with code {process.returncode}: {said[-1] if said else 'it said nothing'}")
    return process.returncode


class QemuBoard(StepBoard):
    """The board that runs each vector in a QEMU process of its own. core: a key of MACHINES, "" for the default; image:
    the ELF file that it runs."""

    task_kinds = ("retune",)

    def __init__(self, core: str = "", image: Path | None = None) -> None:
        self.name = f"qemu:{core}" if core else "qemu"
        core = core or DEFAULT_CORE
        program = shutil.which(PROGRAM)
        if program is None:
            raise UsageError(f"{PROGRAM} is not installed; on Debian or Ubuntu: apt install qemu-system-arm")
        self.image, self._named, self._core = image or _find_image(core), image is not None, core
        self._command = [program, "-M", MACHINES[core], "-icount", "shift=5", "-nographic"]
        self._command += ["-semihosting-config", "enable=on,target=native", "-kernel"]

    def command(self, system: str) -> list[str]:
        """The command that runs a system's program; it reads INPUT from the folder in which it is started."""
        return [*self._command, str(self._program(system))]

    def _program(self, system: str) -> Path:
        """The ELF file that runs a system; where none was named, the one of every system where `all` leaves it out."""
        left_out = not self._named and system in images.left_out_of_all()
        return _find_image(self._core, WHOLE) if left_out else self.image

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        """Raises LinkError when QEMU fails or hangs, UsageError when the image refuses the parameters."""
        return self.run_changed(params, (), raw, setpoint)

    def run_task(self, task: Task) -> Answer:
        return self.run_changed(task.params, task.changes, task.raw, task.setpoint)

    def words_of_task(self, task: Task, step: int) -> dict[str, int]:
        words = self.run_task(task).words
        assert words is not None
        return {name: int(values[step]) for name, values in words.items()}

    def run_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        steps = len(raw)
        with tempfile.TemporaryDirectory(prefix="plumb-qemu-") as temporary:
            folder = Path(temporary)
            (folder / INPUT).write_bytes(input_file(params, changes, raw, setpoint))
            code = _run(self.command(params.system), folder, START_UP_S + steps * 1e-3)
            if code:
                raise UsageError(f"the QEMU image stopped: {_EXIT_REASONS[code]}")
            return self._answer((folder / "plumb-out.bin").read_bytes(), steps, params.system)

    def _answer(self, data: bytes, steps: int, system: str) -> Answer:
        record = RECORDS[system]
        magic, words_bytes = struct.unpack_from("<2I", data)
        if magic != MAGIC_OUT or words_bytes != record.itemsize:
            raise UsageError(
                f"the QEMU image gives {words_bytes} bytes of words for a step, not {record.itemsize}; "
                "build the image again"
            )
        layout = np.dtype([("words", record), ("digest", "<u4")])
        if len(data) != 8 + steps * layout.itemsize:
            raise LinkError(f"{PROGRAM} wrote {len(data)} bytes for {steps} steps; run it again")
        answers = np.frombuffer(data, layout, offset=8)
        return Answer(answers["digest"].copy(), Words(answers["words"].copy()))

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        words = self.run_injected(params, raw[: step + 1], setpoint[: step + 1]).words
        assert words is not None
        return {name: int(values[step]) for name, values in words.items()}

    def stepper(self, params: ControlParams) -> Stepper:
        raise UsageError("qemu takes whole runs only; close the loop with native, then replay its inputs on qemu")
