"""The C core in this process, by ctypes: the functions of `plumb.contract.run_fixed` at the speed of C.

The library is the one installed with the package, or in a checkout the build of the `native` preset.
"""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plumb.boards.native.build import BUILD, stale_text
from plumb.checkout import CHECKOUT, PACKAGE
from plumb.contract.parameters import Changes, ControlParams
from plumb.contract.run_fixed import check_inputs, parts_of
from plumb.errors import UsageError
from plumb.spec import declarations, parameters
from plumb.spec.records import PLAUSIBILITY, RECORDS, VALIDITY, Words, block_dtype, names_of
from plumb.systems.tasks import Task
from plumb.tuning.variances import variance_turn2_q56

LIBRARY = "libplumb_native.so"
CORE_VARIABLE = "PLUMB_NATIVE_CORE"
"""Environment variable: the library to load instead, for example one with systems of PLUMB_SYSTEM_PATH."""
KALMAN_DTYPE = block_dtype("kalman")
"""plumb_kalman_t: the state of one filter after a step."""

PID_DTYPE = block_dtype("pid")
"""plumb_pid_t: the state of one controller after a step."""

Int32s = npt.NDArray[np.int32]
Records = npt.NDArray[np.void]


def core_path() -> Path:
    """Path of the library: PLUMB_NATIVE_CORE, in the package, or in the checkout's build. Without one raises
    UsageError, which says how to build it."""
    if chosen := os.environ.get(CORE_VARIABLE):
        return Path(chosen)
    for path in (PACKAGE / LIBRARY, CHECKOUT / "build" / "native" / LIBRARY):
        if path.is_file():
            return path
    raise UsageError(f"the native core is not built: run '{BUILD}' in the checkout, or 'pip install .' there")


@lru_cache(maxsize=1)
def c_core() -> ctypes.CDLL:
    """The loaded library; raises UsageError when its version differs from the package's."""
    path = core_path()
    try:
        core = ctypes.CDLL(str(path))
        core.plumb_word_names.restype = ctypes.c_char_p
        core.plumb_crc32.restype = ctypes.c_uint32
        fits = (
            all(word_names(core, system) in (names_of(system), ()) for system in RECORDS)
            and any(word_names(core, system) for system in RECORDS)
            and core.plumb_params_count() == sum(row.owner == "control" for row in parameters.table())
            and core.plumb_sizeof_kalman() == KALMAN_DTYPE.itemsize
            and core.plumb_sizeof_pid() == PID_DTYPE.itemsize
        )
    except (OSError, AttributeError) as error:
        other = f"{path} is not this core ({error}): run '{BUILD}' in the checkout"
        raise UsageError(stale_text(path) or other) from error
    if not fits:
        other = f"{path} is of another version than this package: run '{BUILD}' in the checkout"
        raise UsageError(stale_text(path) or other)
    return core


def _number(system: str) -> int:
    return declarations.system(system).number


def word_names(core: ctypes.CDLL, system: str) -> tuple[str, ...]:
    """Names of the words of a system's record in the C library; () for a system that it does not have."""
    names: bytes | None = core.plumb_word_names(_number(system))
    return tuple(names.decode().split(",")) if names else ()


def _pointer(array: npt.NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _i32(values: npt.ArrayLike) -> Int32s:
    return np.ascontiguousarray(values, np.int32)


def _u32(values: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    return np.ascontiguousarray(np.asarray(values, np.int64) & 0xFFFFFFFF, np.uint32)


def params_valid(params: ControlParams) -> bool:
    """Whether the firmware would accept this set of parameters at a commit."""
    return bool(c_core().plumb_params_valid(_pointer(_u32(params.words()))))


def require_valid(params: ControlParams) -> None:
    """Raises UsageError for parameters that the core refuses, because its arithmetic could divide by zero with them."""
    if not word_names(c_core(), params.system):
        raise UsageError(f"the native core was built without {params.system}: build it with PLUMB_SYSTEMS that has it")
    if not params_valid(params):
        refused = f"the core refuses these parameters of {params.system}; take those of a tuning"
        raise UsageError(stale_text(core_path()) or refused)


def crc32(data: bytes) -> int:
    return int(c_core().plumb_crc32(data, len(data)))


def atan2(y: npt.ArrayLike, x: npt.ArrayLike) -> Int32s:
    """Binary angles of the points (x, y), any int32."""
    rows, columns = _i32(y), _i32(x)
    out = np.empty_like(rows)
    c_core().plumb_atan2_run(_pointer(rows), _pointer(columns), rows.size, _pointer(out))
    return out


def asin(x_q30: npt.ArrayLike) -> Int32s:
    """Binary angles whose sines are x / 2^30."""
    sines = _i32(x_q30)
    out = np.empty_like(sines)
    c_core().plumb_asin_run(_pointer(sines), sines.size, _pointer(out))
    return out


def sincos(turn_q32: npt.ArrayLike) -> tuple[Int32s, Int32s]:
    """Sine and cosine of binary angles, Q30."""
    turns = _i32(turn_q32)
    sine, cosine = np.empty_like(turns), np.empty_like(turns)
    c_core().plumb_sincos_run(_pointer(turns), turns.size, _pointer(sine), _pointer(cosine))
    return sine, cosine


def length(y: npt.ArrayLike, x: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Half the lengths of the vectors (x, y), components of at most 7 * 2^28."""
    ys, xs = _i32(y), _i32(x)
    out = np.empty(ys.shape, np.uint32)
    c_core().plumb_length_run(_pointer(ys), _pointer(xs), ys.size, _pointer(out))
    return out


def reciprocal(d: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """2^61 / d, 2^30 <= d < 2^31."""
    divisors = _u32(d)
    out = np.empty_like(divisors)
    c_core().plumb_reciprocal_run(_pointer(divisors), divisors.size, _pointer(out))
    return out


def tilt_and_trust(
    params: ControlParams, accel_y_g_q26: npt.ArrayLike, accel_z_g_q26: npt.ArrayLike
) -> tuple[Int32s, npt.NDArray[np.uint32]]:
    """Measured tilt, turn Q32, and R in 2^32 lsb."""
    require_valid(params)
    y, z = _i32(accel_y_g_q26), _i32(accel_z_g_q26)
    turn, variance = np.empty_like(y), np.empty(y.shape, np.uint32)
    words = _u32(params.words())
    c_core().plumb_tilt_run(_pointer(words), _pointer(y), _pointer(z), y.size, _pointer(turn), _pointer(variance))
    return turn, variance


def kalman_run(
    params: ControlParams, variance: npt.ArrayLike, tilt_turn_q32: npt.ArrayLike, rate_turnps_q28: npt.ArrayLike
) -> tuple[Int32s, Records]:
    """Run the filter alone from its start: fused tilt, shape (steps[, runs]), and the final state of each run.

    rate_turnps_q28: U(k) of each step, used as given (control_step() would choose the sample).
    """
    r, z, u = _u32(variance), _i32(tilt_turn_q32), _i32(rate_turnps_q28)
    runs = z.shape[1] if z.ndim == 2 else 1
    require_valid(params)
    fused, states = np.empty_like(z), np.zeros(runs, KALMAN_DTYPE)
    c_core().plumb_kalman_run(
        _pointer(_u32(params.words())), _pointer(r), _pointer(z), _pointer(u), len(z), runs, _pointer(states),
        _pointer(fused),
    )  # fmt: skip
    return fused, states


def kalman_step(
    params: ControlParams, states: Records, variance: npt.ArrayLike, tilt_turn_q32: npt.ArrayLike, rate: npt.ArrayLike
) -> Records:
    """One step for each of n independent states of KALMAN_DTYPE."""
    r, z, u, after = _u32(variance), _i32(tilt_turn_q32), _i32(rate), states.copy()
    words = _u32(params.words())
    c_core().plumb_kalman_each(_pointer(words), _pointer(after), _pointer(r), _pointer(z), _pointer(u), len(after))
    return after


def pid_step(params: ControlParams, states: Records, error_turn_q32: npt.ArrayLike, rate: npt.ArrayLike) -> Records:
    """One step for each of n independent states of PID_DTYPE."""
    error, measured, after = _i32(error_turn_q32), _i32(rate), states.copy()
    words = _u32(params.words())
    c_core().plumb_pid_each(_pointer(words), _pointer(after), _pointer(error), _pointer(measured), len(after))
    return after


def pid_retune(old: ControlParams, new: ControlParams, states: Records) -> Records:
    """Other gains for each of n independent states of PID_DTYPE."""
    after, before_words, after_words = states.copy(), _u32(old.words()), _u32(new.words())
    c_core().plumb_pid_retune_each(_pointer(before_words), _pointer(after_words), _pointer(after), len(after))
    return after


class Controller:
    """One run, a step at a time; this object owns the state."""

    def __init__(self, params: ControlParams) -> None:
        require_valid(params)
        self._core, self._params = c_core(), _u32(params.words())
        self._memory = np.zeros(self._core.plumb_sizeof_control() // 8 + 1, np.int64)
        self._record = np.zeros(1, RECORDS[params.system])
        self._whole_inputs = declarations.system(params.system).whole_inputs
        self._core.plumb_control_init(_pointer(self._memory), _pointer(self._params))

    def step(self, raw: Sequence[int], setpoint: int) -> dict[str, int]:
        """The words of this step by name; raw: the inputs, or the first of them (`System.whole_inputs`)."""
        counts = np.array(self._whole_inputs(raw), np.int16)
        target = ctypes.c_int32(int(setpoint))
        self._core.plumb_control_step(_pointer(self._memory), _pointer(self._params), _pointer(counts), target)
        self._core.plumb_control_words(_pointer(self._memory), _pointer(self._params), _pointer(self._record))
        return dict(zip(self._record.dtype.names or (), self._record[0].item(), strict=True))

    def retune(self, params: ControlParams) -> None:
        """Other values of live parameters from the next step on."""
        require_valid(params)
        words = _u32(params.words())
        self._core.plumb_control_retune(_pointer(self._memory), _pointer(self._params), _pointer(words))
        self._params = words

    def run(self, raw: npt.NDArray[np.int64], setpoint: npt.NDArray[np.int64]) -> Words:
        """Run a step for each row of checked inputs (`check_inputs`); returns their records."""
        counts, targets = np.ascontiguousarray(raw, np.int16), np.ascontiguousarray(setpoint, np.int32)
        record = np.zeros(len(counts), self._record.dtype)
        self._core.plumb_control_steps(
            _pointer(self._memory), _pointer(self._params), _pointer(counts), _pointer(targets), len(counts),
            _pointer(record),
        )  # fmt: skip
        return Words(record)

    def digest(self) -> int:
        """CRC-32 of the last step's words, by the core's own function."""
        return crc32(self._record.tobytes())


class Controllers:
    """Runs of one set of parameters side by side, a step of all at a time, for closed loops over many seeds."""

    def __init__(self, params: ControlParams, runs: int) -> None:
        require_valid(params)
        self._core, self._params = c_core(), _u32(params.words())
        size = self._core.plumb_sizeof_control()
        self._memory = np.zeros((runs, size), np.uint8)  # one behind the other, as an array in C
        self._record = np.zeros(runs, RECORDS[params.system])
        self._setpoints = np.zeros(runs, np.int32)
        system = declarations.system(params.system)
        self._inputs = np.tile(np.array(system.whole_inputs([0] * system.counts), np.int16), (runs, 1))
        for control in self._memory:
            self._core.plumb_control_init(_pointer(control), _pointer(self._params))

    def step(self, raw: npt.NDArray[np.int16], setpoint: npt.ArrayLike = 0) -> Words:
        """The words of this step, (runs,). raw: (runs, inputs), or the first of them (`System.whole_inputs`); setpoint:
        one, or (runs,)."""
        self._inputs[:, : raw.shape[1]] = raw
        self._setpoints[:] = setpoint
        self._core.plumb_control_each(
            _pointer(self._memory), _pointer(self._params), _pointer(self._inputs), _pointer(self._setpoints),
            len(self._record), _pointer(self._record),
        )  # fmt: skip
        return Words(self._record)


def system_name(params: ControlParams | Sequence[ControlParams]) -> str:
    """The system of all parameter sets; raises UsageError if they belong to different ones."""
    names = {one.system for one in ([params] if isinstance(params, ControlParams) else params)}
    if len(names) != 1:
        raise UsageError(f"runs of {' and '.join(sorted(names)) or 'no system'} cannot be batched: give one system's")
    return names.pop()


def run_control(params: ControlParams | Sequence[ControlParams], raw: npt.ArrayLike, setpoint: npt.ArrayLike) -> Words:
    """The words of every step of one or more runs. raw: (steps, inputs[, runs]), as `check_inputs` takes them;
    setpoint: (steps[, runs]); params: one set, or one per run."""
    name = system_name(params)
    counts, setpoints = check_inputs(name, raw, setpoint)
    (steps, inputs), runs = counts.shape[:2], counts.shape[2] if counts.ndim == 3 else 1
    sets = [params] * runs if isinstance(params, ControlParams) else list(params)
    if len(sets) != runs:
        raise UsageError(f"{len(sets)} parameter sets were given for {runs} runs: give one, or one per run")
    record = np.zeros((runs, steps), RECORDS[name])
    by_run = np.ascontiguousarray(np.moveaxis(counts.reshape(steps, inputs, runs), 2, 0), np.int16)
    targets = np.ascontiguousarray(setpoints.reshape(steps, runs).T, np.int32)
    core = c_core()
    for run, one in enumerate(sets):
        require_valid(one)
        core.plumb_control_run(
            _pointer(_u32(one.words())),
            _pointer(by_run[run]),
            _pointer(targets[run]),
            steps,
            _pointer(record[run]),
            None,
        )
    return Words(record.T if counts.ndim == 3 else record[0])


def run_changed(params: ControlParams, changes: Changes, raw: npt.ArrayLike, setpoint: npt.ArrayLike) -> Words:
    """As `run_control` for one run, whose parameters change at the given steps; the state stays."""
    counts, setpoints = check_inputs(params.system, raw, setpoint)
    controller, parts = Controller(params), []
    for number, (part, now) in enumerate(parts_of(params, changes, len(counts))):
        if number:
            controller.retune(now)
        parts.append(controller.run(counts[part], setpoints[part]).record)
    return Words(np.concatenate(parts))


def run_task(task: Task) -> Words:
    """Run a task other than plain steps with this library."""
    if task.kind == "refusal":
        return Words(np.array([(int(params_valid(table)),) for table in task.tables], VALIDITY))
    words = run_changed(task.params, task.changes, task.raw, task.setpoint)
    return _plausibility(task.params, words, task.unit_turn2_q56) if task.kind == "plausibility" else words


def plausibility(params: ControlParams, words: Words) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16]]:
    """Run core/plausibility.c over the records of one run: after each step the bits of the failing checks, and of the
    missing conditions for arming, each of shape (steps,). Raises UsageError for a system without plausibility
    bounds."""
    found = _plausibility(params, words, variance_turn2_q56(params))
    return found["failed"].astype(np.uint16), found["missing"].astype(np.uint16)


def _plausibility(params: ControlParams, words: Words, unit_turn2_q56: int) -> Words:
    """The whole state after every step."""
    found = np.zeros(len(words.record), PLAUSIBILITY)
    record, table = np.ascontiguousarray(words.record), _u32(params.words())
    unit = ctypes.c_uint32(unit_turn2_q56)
    if not c_core().plumb_plausibility_run(_pointer(table), _pointer(record), len(record), unit, _pointer(found)):
        raise UsageError(f"{params.system} has no output with the checks axis or ride: no plausibility is checked")
    return Words(found)


def takeoff(params: ControlParams, words: Words, dt_s_q33: int) -> npt.NDArray[np.uint32]:
    """Run core/takeoff.c over the records of one run: after each step the time for which it has been ready (s Q33), the
    mean rate (turn/s Q28) and the bits of what is missing, shape (steps, 3). Raises UsageError for a system that does
    not fly."""
    found = np.zeros((len(words.record), 3), np.uint32)
    record, table = np.ascontiguousarray(words.record), _u32(params.words())
    step = ctypes.c_uint32(dt_s_q33)
    if not c_core().plumb_takeoff_run(_pointer(table), _pointer(record), len(record), step, _pointer(found)):
        raise UsageError(f"{params.system} does not fly: there are no conditions for a takeoff")
    return found


def kalman_steps_per_s(params: ControlParams, runs: int = 64, steps: int = 4000, repeats: int = 5) -> float:
    """Batched filter steps per second on one processor core, the best of `repeats`."""
    rng = np.random.default_rng(1)
    z = rng.integers(-(1 << 28), 1 << 28, (steps, runs)).astype(np.int32)
    u = rng.integers(-(1 << 26), 1 << 26, (steps, runs)).astype(np.int32)
    r = np.full((steps, runs), params["tilt.r_base"], np.uint32)
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        kalman_run(params, r, z, u)
        best = min(best, time.perf_counter() - start)
    return runs * steps / best
