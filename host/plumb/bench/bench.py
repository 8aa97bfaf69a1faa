"""Instructions, estimated cycles, bytes, stack and error of the kernels in the shipped image, against their budgets.

The image's own machine code runs, called by symbol (plumb.bench.instruction_counter). control_step runs whole, over
ordinary and wild input with every shipped tuning of hurried. The kernels are inlined into it and found by the debug
information: their rows count the instructions of a step that came from them, and have the stack of the step. The other
systems' steps run over the inputs of their golden vectors; where a system declares no budget, the row gives the share
of the shortest period that the board accepts. The digest of hurried's record by the chip's CRC unit is compared with
zlib's. The check of guarded memory is not part of a step: it runs in every turn of the loop outside lockstep, as does
the sealing, which takes as long. A whole step in lockstep runs on the virtual board, from the first character of its
sample on the UART to the last of its reply, with every turn of the loop and every interrupt between; that row is a
mean, because in some steps the board also sends its status. A frame of a live flight (plumb.bench.live_frame) is
measured there, too, from tick to tick. Numbers are the worst of all inputs: an upper bound per
path by plumb.bench.m3_timing, exact in instructions. Errors are against float64 on the same inputs, in degrees; for
pid_step as a fraction of full command. They are those of the Arm code, except for the filter, the whole chain, atan2
and asin: these need more steps than an emulator can run in reasonable time, and run on the native core
(plumb.proof.accuracy), which golden vectors hold equal to the bit.
"""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from plumb import systems
from plumb.bench.instruction_counter import Counter, Image, InstructionTrace
from plumb.bench.live_frame import LiveFrame, live_frame
from plumb.bench.m3_timing import path_cost
from plumb.boards.native import core as native_core
from plumb.boards.virtual import VirtualBoard
from plumb.checkout import CHECKOUT
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.flash.call_graph import CallGraph
from plumb.flash.named_images import named_image
from plumb.kernels.reference import kernels as reference_kernels
from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.proof import golden
from plumb.proof.accuracy import TURN_DEG, chain_error_deg, filter_error_deg, hard_inputs, scenario_error_deg
from plumb.proof.compare import count_mismatches
from plumb.proof.golden_random import random_bits
from plumb.proof.golden_recipe import WILD
from plumb.spec import declarations, images
from plumb.spec.protocol import protocol
from plumb.spec.records import RECORDS, Words
from plumb.spec.system import COMMAND_WORDS_MAX, COUNTS_MAX, WORDS_PER_FRAME, group_of
from plumb.tuning.groups import pid_of
from plumb.tuning.variances import variance_turn2_q56

IMAGE = Path("build/stm32f103/firmware.elf")
CONTROL_BYTES = 1024
"""Memory for control_t, whose first member is the record of the step."""
INPUT_BYTES = 2 * (COUNTS_MAX + COMMAND_WORDS_MAX + WORDS_PER_FRAME)
"""Memory for the inputs of a step of any system."""
WILD_STEPS = 200
SPREAD_STEPS = 600
"""Steps of a vector for a system that spreads its work over many steps, and so has a budget for the mean."""
MOTION_STEPS = 1500
ANGLES = 200_000
KALMAN_STEPS = 20_000
RATE_FRAMES = 20_000
DIGESTS, FLIPS = 20, 10
EXCHANGES = 60
"""Number of lockstep steps that are counted; in three of them the board sends its periodic status."""
ASIN_LIMIT_DEG = 80.0
"""Beyond this angle the arcsine is so steep that its error has no budget."""


@dataclass(frozen=True)
class Budget:
    """Budget of a kernel: cycles at zero wait states (None: not set) and their goal; error and its unit; instructions,
    for a budget in instructions; cycles_mean, for the mean of all calls; period_us, of which the worst call may take
    WORST_SHARE at two wait states."""

    cycles: int | None
    stretch: int
    max_err: float
    unit: str
    instructions: int | None = None
    cycles_mean: int | None = None
    period_us: int | None = None

    @property
    def cycles_2ws(self) -> float:
        """The limit at two wait states."""
        return math.inf if self.period_us is None else WORST_SHARE * self.period_us * CYCLES_PER_US


CYCLES_PER_US = 72
WORST_SHARE = 0.3
STEP_OF = "control_step_"
"""Prefix of the row of another system's step; the system's name follows."""


HURRIED = min((s.cycles, s.name) for s in declarations.systems().values() if s.cycles is not None)[1]
"""The system with the tightest budget of cycles, in which the rows of the kernels are measured."""
hurried = systems.load(HURRIED)


def _step_row(system: str) -> str:
    return "control_step" if system == HURRIED else f"{STEP_OF}{system}"


# The error of control_step is that of the whole chain from counts to angle, over the system's own motion.
BUDGETS = {
    "kalman_step": Budget(200, 145, 5e-4, "deg"),
    "atan2": Budget(180, 90, 5e-6, "deg"),
    "asin": Budget(200, 180, 2e-5, "deg"),
    "pid_step": Budget(75, 60, 1e-6, "command"),
    **{
        _step_row(name): Budget(declared.cycles, 0, 5e-4, "deg", cycles_mean=declared.cycles_mean)
        for name, declared in declarations.systems().items()
    },
    "plausibility_step": Budget(None, 0, 0.0, "wrong answers"),
    "digest_crc32": Budget(400, 360, 0.0, "wrong digests"),
    "board_memory_intact": Budget(2800, 2400, 0.0, "wrong answers"),
    "lockstep_step": Budget(None, 0, 0.0, "wrong digests", instructions=4300),
    "live_frame": Budget(None, 0, 0.0, "frames without one step", cycles_mean=22_000, period_us=2500),
}
PLAUSIBILITY_BYTES, PLAUSIBILITY_ANSWER = 56, slice(25, 27)
"""Size of plausibility_t in bytes, and the places of `failed` and `missing` in it, in half-words."""
FLOWN = "quadrotor"
"""The system whose frame is measured in flight."""
SHORTEST_PERIOD_CYCLES = 500 * CYCLES_PER_US
"""The shortest `period_us`, 500, in cycles."""
IMAGE_STRETCH = {"flash": 24 * 1024, "ram + stack": 6 * 1024}


@dataclass(frozen=True)
class Row:
    """One kernel, measured over all inputs."""

    instructions_min: int
    instructions_max: int
    cycles_max: int
    cycles_mean: int
    cycles_2ws_max: int
    bytes: int
    stack: int
    max_err: float

    def verdict(self, budget: Budget) -> str:
        over = []
        if budget.cycles is not None and self.cycles_max > budget.cycles:
            over.append(f"{self.cycles_max - budget.cycles} cycles over")
        if budget.cycles_mean is not None and self.cycles_mean > budget.cycles_mean:
            over.append(f"{self.cycles_mean - budget.cycles_mean} cycles over in the mean")
        if self.cycles_2ws_max > budget.cycles_2ws:
            over.append(f"{self.cycles_2ws_max - budget.cycles_2ws:.0f} cycles over at two wait states")
        if budget.instructions is not None and self.instructions_max > budget.instructions:
            over.append(f"{self.instructions_max - budget.instructions} instructions over")
        if not self.max_err <= budget.max_err:
            over.append("error over")
        if budget.cycles_mean is not None and not over:
            mean = f"ok, {self.cycles_mean} cycles in the mean of {budget.cycles_mean}"
            if budget.period_us is None:
                return mean
            share = self.cycles_2ws_max / (budget.period_us * CYCLES_PER_US)
            return f"{mean}; {100 * share:.0f} % of {budget.period_us} us"
        if budget.cycles is None and not over:
            return f"{100 * self.cycles_2ws_max / SHORTEST_PERIOD_CYCLES:.0f} % of 500 us"
        return ", ".join(over) or ("stretch" if self.cycles_max <= budget.stretch else "ok")


class BenchJson(TypedDict):
    """The output of `bench --json`: the figures of each row, and the sizes of the image in bytes."""

    kernels: dict[str, dict[str, object]]
    image: dict[str, int]


@dataclass(frozen=True)
class BenchResult:
    """Every row, the image's sizes and limits in bytes, and rates of the host, which have no budget."""

    kernels: dict[str, Row]
    image: dict[str, int]
    limits: dict[str, int]
    rates: dict[str, float]

    def to_json(self) -> BenchJson:
        kernels = {name: asdict(row) for name, row in self.kernels.items()}
        for row in kernels.values():
            del row["instructions_min"]
        return {"kernels": kernels, "image": self.image}

    def _image_sizes(self) -> dict[str, tuple[int, int]]:
        """Size and limit of what the image takes."""
        return {
            "flash": (self.image["flash"], self.limits["flash"]),
            "ram + stack": (self.image["ram"] + self.image["stack"], self.limits["ram"]),
        }

    @property
    def within_budget(self) -> bool:
        kernels = all("over" not in row.verdict(BUDGETS[name]) for name, row in self.kernels.items())
        return kernels and all(size <= limit for size, limit in self._image_sizes().values())

    def render(self) -> str:
        """The rows as a table of text."""
        lines = [f"{'kernel':<24}{'instr':>6}{'cycles':>8}{'2 ws':>7}{'budget':>8}{'bytes':>7}{'stack':>7}  error"]
        for name, row in self.kernels.items():
            budget = BUDGETS[name]
            limits = [f"{budget.instructions} i" if budget.instructions else None, budget.cycles, "-"]
            allowed = next(str(limit) for limit in limits if limit is not None)
            lines.append(
                f"{name:<24}{row.instructions_max:>6}{row.cycles_max:>8}{row.cycles_2ws_max:>7}{allowed:>8}"
                f"{row.bytes:>7}{row.stack:>7}  {row.max_err:.1e} {budget.unit} (limit {budget.max_err:.0e}): "
                f"{row.verdict(budget)}"
            )
        lines.append("")
        for name, (size, limit) in self._image_sizes().items():
            word = "over" if size > limit else "stretch" if size <= IMAGE_STRETCH[name] else "ok"
            lines.append(f"image {name:<12}{size:>7} of {limit} bytes: {word}")
        lines.append(f"image ram {self.image['ram']} (.data + .bss), worst-case stack {self.image['stack']} bytes")
        lines += [f"{name}: {rate:,.0f} per second on this machine" for name, rate in self.rates.items()]
        lines.append("cycles: estimated by the processor manual's table, worst case; 2 ws: two flash wait states")
        return "\n".join(lines)


def find_image(image: Path | None = None) -> Path:
    """`image`, or the checkout's build; raises UsageError when there is none."""
    candidates = [image] if image else [Path.cwd() / IMAGE, CHECKOUT / IMAGE]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise UsageError(f"there is no {candidates[0]}; build it with make image in a checkout of plumb")


@dataclass(frozen=True)
class _Run:
    """One run of control_step as Arm code: its parameters, whether its input was ordinary, its words."""

    params: ControlParams
    ordinary: bool
    raw: npt.NDArray[np.int64]
    setpoint: npt.NDArray[np.int64]
    words: Words


def _inputs(tunings: Sequence[str]) -> Iterator[tuple[str, bool, npt.NDArray[np.int64], npt.NDArray[np.int64]]]:
    """(tuning, whether a sensor could give these counts, raw (steps, 6), setpoint (steps,)) of each run."""
    for index, name in enumerate(tunings):
        seconds = MOTION_STEPS * hurried.PERIOD_US * 1e-6
        motion = hurried.scenario("motion", 3000 + index, seconds=seconds)
        yield name, True, motion.counts().astype(np.int64), motion.setpoint().astype(np.int64)
        for make in WILD.values():
            yield name, False, *make(4000 + index, WILD_STEPS)


def _pack(numbers: npt.ArrayLike, kind: str) -> bytes:
    return np.asarray(numbers).astype(kind).tobytes()


class StepDriver:
    """Runs control_init and control_step in a counter, which collects their profiles."""

    def __init__(self, counter: Counter, groups: Collection[str] | None = None) -> None:
        """groups: of parameters that the image holds; None: all."""
        self._counter, self._groups = counter, groups
        self._control, self._room = counter.place(bytes(CONTROL_BYTES)), counter.place(bytes(INPUT_BYTES))
        self._table = counter.place(bytes(4 * 256))

    def begin(self, params: ControlParams) -> None:
        """The initial state."""
        held = [
            word
            for name, word in params.values.items()
            if self._groups is None or group_of(name) in {*self._groups, ""}
        ]
        self._counter.write(self._table, _pack(np.array(held) & 0xFFFF_FFFF, "<u4"))
        self._counter.call("control_init", self._control, self._table)

    def step(self, counts: npt.ArrayLike, setpoint: int) -> None:
        """One step."""
        self._counter.write(self._room, _pack(counts, "<i2"))
        self._counter.call("control_step", self._control, self._table, self._room, setpoint)

    def run(self, params: ControlParams, raw: npt.ArrayLike, setpoint: npt.ArrayLike) -> Words:
        """Run from the initial state; the record of every step."""
        size = RECORDS[params.system].itemsize
        self.begin(params)
        record, rows = bytearray(), np.asarray(raw)
        for counts, target in zip(rows, np.asarray(setpoint), strict=True):
            self.step(counts, int(target))
            record += self._counter.read(self._control, size)
        return Words.from_bytes(record, (len(rows),), params.system)


def _run_control(counter: Counter, tunings: Sequence[str]) -> list[_Run]:
    """Runs of every input of the system HURRIED."""
    driver, runs = StepDriver(counter), []
    for tuning, ordinary, raw, setpoint in tqdm(list(_inputs(tunings)), disable=None, leave=False, unit="run"):
        params = quantise(hurried.TUNINGS[tuning])
        runs.append(_Run(params, ordinary, raw, setpoint, driver.run(params, raw, setpoint)))
    return runs


def _step_of(elf: Image, system: str) -> Row:
    """Row of another system's step over the first steps of every vector of its recipe; its error is that of its
    scenario. One that `elf` leaves out is measured in its own image."""
    own_image, groups = images.left_out_of_all().get(system), None
    if own_image is not None:
        elf, groups = Image(named_image(system).with_suffix(".elf")), images.held_groups(own_image.systems)
    counter = Counter(elf, ["control_step"])
    driver = StepDriver(counter, groups)
    steps = WILD_STEPS if declarations.system(system).cycles_mean is None else SPREAD_STEPS
    for case in golden.cases(golden.vectors_folder(None), [system]):
        vector = case.vector
        given = vector.params, vector.raw, vector.setpoint
        params, raw, setpoint = case.entry.inputs() if vector.kind == "refusal" else given  # which has no steps
        driver.run(params, raw[:steps], setpoint[:steps])
    own = systems.load(system)
    return _row(counter, "control_step", scenario_error_deg(own.TUNINGS[own.DEFAULT_TUNING], own.DEFAULT_SCENARIO))


def _digest(elf: Image) -> Row:
    """Row of the digest of a step of HURRIED by the chip's CRC unit; its error is the number that differ from
    zlib's."""
    counter = Counter(elf, ["digest_crc32"])
    size, wrong = RECORDS[HURRIED].itemsize, 0
    place = counter.place(bytes(size))
    for seed in range(DIGESTS):
        record = random_bits(100 + seed, size // 8 + 1).tobytes()[:size]
        counter.write(place, record)
        wrong += counter.call("digest_crc32", place, size).result != zlib.crc32(record)
    return _row(counter, "digest_crc32", wrong)


def _plausibility(elf: Image) -> Row:
    """Row of the plausibility of HURRIED's steps, over `motion` and over wild counts; its error is the number of
    answers that differ from the native core's."""
    counter, wrong = Counter(elf, ["plumb_plausibility_step"]), 0
    state, record = counter.place(bytes(PLAUSIBILITY_BYTES)), counter.place(bytes(RECORDS[HURRIED].itemsize))
    bounds, params = (
        elf.symbol(f"plumb_{HURRIED}_plausibility").address,
        quantise(hurried.TUNINGS[hurried.DEFAULT_TUNING]),
    )
    dt_s_q33, unit = params["kalman.dt_s_q33"], variance_turn2_q56(params)
    for _, _, raw, setpoint in _inputs(["adaptive"]):
        words = native_core.run_control(params, raw[:WILD_STEPS], setpoint[:WILD_STEPS])
        failed, missing = native_core.plausibility(params, words)
        counter.call("plumb_plausibility_init", state)
        for step, row in enumerate(words.record):
            counter.write(record, row.tobytes())
            counter.call("plumb_plausibility_step", state, bounds, record, dt_s_q33, unit)
            answer = np.frombuffer(counter.read(state, PLAUSIBILITY_BYTES), "<u2")[PLAUSIBILITY_ANSWER]
            wrong += tuple(answer.tolist()) != (int(failed[step]), int(missing[step]))
    return _row(counter, "plumb_plausibility_step", wrong)


def _memory_check(elf: Image) -> Row:
    """Row of the check of all guarded memory; its error is the number of wrong answers: after sealing the memory is
    intact, with one bit flipped it is not."""
    counter, wrong = Counter(elf, ["board_memory_intact"]), 0
    for area in ("guarded", "guarded_parameters"):
        start, end = (elf.symbol(f"{area}_{place}").address for place in ("start", "end"))
        for address in range(start, end, (end - start) // FLIPS):
            counter.call("board_memory_seal")
            counter.call("board_parameters_seal")
            wrong += counter.call("board_memory_intact").result & 0xFF != 1
            byte = counter.read(address, 1)[0]
            counter.write(address, bytes((byte ^ 0x10,)))
            wrong += counter.call("board_memory_intact").result & 0xFF != 0
    return _row(counter, "board_memory_intact", wrong)


def _lockstep(elf: Image) -> Row:
    """Row of a step of HURRIED in lockstep over the UART of the virtual board, one at a time; its error is the number
    of digests that differ from the native core's. Exceptions are counted as branches, without the 12 cycles of their
    entry."""
    params, motion = (
        quantise(hurried.TUNINGS[hurried.DEFAULT_TUNING]),
        hurried.scenario("motion", 3000, seconds=EXCHANGES * hurried.PERIOD_US * 1e-6),
    )
    raw, setpoint = motion.counts(), motion.setpoint()
    with VirtualBoard(elf.path) as board:
        stepper = board.stepper(params)
        trace = InstructionTrace(board.machine)
        answers = [stepper.step(tuple(row), int(sp)) for row, sp in zip(raw.tolist(), setpoint, strict=True)]
    expected = native_core.run_control(params, raw, setpoint).digests()
    wrong = count_mismatches(expected, np.array([answer.digest for answer in answers], np.uint32))
    cost = path_cost([elf.instruction(address) for address in trace.addresses])
    code = {elf.symbol_at(address) for address in set(trace.addresses)}
    instructions, cycles, cycles_2ws = (
        -(-total // EXCHANGES) for total in (cost.instructions, cost.cycles, cost.cycles_2ws)
    )
    size = sum(symbol.size for symbol in code if symbol is not None)
    return Row(instructions, instructions, cycles, cycles, cycles_2ws, size, cost.stack, wrong)


def _frame(found: LiveFrame) -> Row:
    """Row of a frame in flight; its error is the number of frames without exactly one step."""
    return Row(
        found.instructions_min,
        found.instructions_max,
        found.cycles_max,
        found.cycles_mean,
        found.cycles_2ws_max,
        found.bytes,
        found.stack,
        found.wrong,
    )


def kalman_error_deg(tunings: Sequence[str]) -> float:
    """Largest tilt error of the filter against float64 on hard inputs, both with the same integer inputs."""
    worst = 0.0
    for name in tunings:
        params = quantise(hurried.TUNINGS[name])
        error_deg = filter_error_deg(params, hard_inputs(params, KALMAN_STEPS, 5))
        worst = max(worst, float(np.abs(error_deg).max()))
    return worst


def pid_error(words: Words, params: ControlParams) -> float:
    """Largest error of the command as a fraction of full command, with the same integer error and rate."""
    settings, state = pid_of(params), reference_kernels.PidState()
    errors_deg = (words["error_turn_q32"] * TURN_DEG).tolist()
    rates_dps = (words["rate_corrected_turnps_q28"] * (360.0 / 2**28)).tolist()
    command = np.empty(len(errors_deg))
    for k, (error_deg, rate_dps) in enumerate(zip(errors_deg, rates_dps, strict=True)):
        reference_kernels.pid_step(state, settings, params.period_s, error_deg, rate_dps)
        command[k] = state.command
    return float(np.abs(words["command_q22"] / 2**22 - command).max())


def angle_errors_deg() -> dict[str, float]:
    """The largest error of atan2, and of asin up to ASIN_LIMIT_DEG, over their range."""
    bits = (random_bits(17, 3 * ANGLES) >> np.uint64(32)).astype(np.int64) - 2**31
    edges = np.array([0, 1, -1, 2**26, -(2**26), 2**31 - 1, -(2**31) + 1])
    shift = bits[2::3] % 30
    y = np.concatenate([bits[0::3] >> shift, np.repeat(edges, len(edges))])
    x = np.concatenate([bits[1::3] >> shift, np.tile(edges, len(edges))])
    pole = (y == 0) & (x == 0)
    direction = np.abs(reference_kernels.wrap(native_core.atan2(y, x) * TURN_DEG - reference_kernels.atan2(y, x)))[
        ~pole
    ]
    sines = np.concatenate([bits >> 1, [0, 1, -1, 2**30, -(2**30), 2**30 - 1, -(2**30) + 1]])
    angle_deg = native_core.asin(sines) * TURN_DEG
    arcsine = np.abs(angle_deg - reference_kernels.asin(sines / 2**30))[np.abs(angle_deg) <= ASIN_LIMIT_DEG]
    return {"atan2": float(direction.max()), "asin": float(arcsine.max())}


def _row(counter: Counter, symbol: str, max_err: float) -> Row:
    profile = counter.profiles[symbol]
    if not profile.calls:
        raise UsageError(f"{counter.image.path.name} never called {symbol}: nothing was measured")
    return Row(
        profile.instructions_min,
        profile.instructions_max,
        profile.cycles_max,
        -(-profile.cycles_sum // profile.calls),
        profile.cycles_2ws_max,
        counter.bytes_of(symbol),
        profile.stack,
        max_err,
    )


def measure(image: Path | None = None) -> BenchResult:
    """Measure everything, which takes about ten seconds; raises UsageError without an image or without the emulator."""
    elf = Image(find_image(image))
    graph = CallGraph(elf.path)
    step = Counter(elf, ["control_step", "kalman_step", "pid_step", "angle_atan2", "angle_asin"])
    runs = _run_control(step, list(hurried.TUNINGS))
    angle_errors = angle_errors_deg()

    ordinary = [run for run in runs if run.ordinary]
    pid_worst = max(pid_error(run.words, run.params) for run in ordinary)
    chain_worst_deg = max(chain_error_deg(run.params, run.raw, run.setpoint) for run in ordinary)
    rows = {
        "kalman_step": _row(step, "kalman_step", kalman_error_deg(list(hurried.TUNINGS))),
        "atan2": _row(step, "angle_atan2", angle_errors["atan2"]),
        "asin": _row(step, "angle_asin", angle_errors["asin"]),
        "pid_step": _row(step, "pid_step", pid_worst),
        "control_step": _row(step, "control_step", chain_worst_deg),
    }
    for name in BUDGETS:
        if name.startswith(STEP_OF):
            rows[name] = _step_of(elf, name.removeprefix(STEP_OF))
    rows["plausibility_step"] = _plausibility(elf)
    rows["digest_crc32"] = _digest(elf)
    rows["board_memory_intact"] = _memory_check(elf)
    rows["lockstep_step"] = _lockstep(elf)
    rows["live_frame"] = _frame(live_frame(FLOWN))
    sizes = {"flash": elf.flash_bytes, "ram": elf.ram_bytes, "stack": graph.worst_stack_bytes()}
    return BenchResult(rows, sizes, elf.limits, rates())


def rates() -> dict[str, float]:
    """Rates of the host per second, best of three; reported without a budget."""
    message = protocol()["STEP"]
    frames = [(message.identifier, message.pack(k, 0, k, k * 2654435761 % 2**32)) for k in range(RATE_FRAMES)]
    text = text_of_frames(frames)
    took = min(_seconds(lambda: SlcanParser().feed(text)) for _ in range(3))
    steps_per_s = native_core.kalman_steps_per_s(quantise(hurried.TUNINGS["adaptive"]))
    return {"native Kalman steps": steps_per_s, "link frames parsed": RATE_FRAMES / took}


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin
