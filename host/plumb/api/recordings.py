"""A recording of a real three-axis sensor, and its replay on a board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.api import arguments
from plumb.api.runs import RunResult
from plumb.boards import open_board
from plumb.boards.contract import StepBoard
from plumb.errors import UsageError
from plumb.proof.scenario_run import ScenarioRun
from plumb.readers import replay
from plumb.spec.arrays import FloatArray


@dataclass(frozen=True)
class Recording:
    """N samples of a three-axis gyro and accelerometer.

    Attributes:
        path: The file.
        time_s: Time of the samples, (N,) s, from 0, rising.
        gyr_radps: Angular rate, (N, 3) rad/s.
        acc_mps2: Specific force, (N, 3) m/s^2.
        truth: Reference attitude w, x, y, z from sensor to earth (z up), (N, 4), NaN where it is lost; None without.
        movement: Samples to be scored, (N,) bool.
    """

    path: Path
    time_s: FloatArray
    gyr_radps: FloatArray
    acc_mps2: FloatArray
    truth: FloatArray | None
    movement: npt.NDArray[np.bool_]

    def replay(
        self,
        system: str | None = None,
        board: str = "native",
        *,
        axis: Literal["x", "y", "z"] = "x",
        period_s: float | None = None,
        seconds: float | None = None,
        link: Literal["serial", "can"] = "serial",
        image: Path | str | None = None,
    ) -> RunResult:
        """Run the recording through a board, and compare every step with the integer model: `plumb replay`.

        An ideal sensor is scaled to a recording in units, and the samples are resampled to the period. A log is
        reproduced as it was recorded: its raw counts, and its parameters with their changes; `verdict` is then about
        three answers, which have to be the same: those of the log, of the board, and of the integer model.

        Args:
            system: `quad`, which estimates one axis, or `phone`, which estimates pitch and roll; None: the one that
                declares itself the default of replays (`default_for` in its system.toml). A log has its own.
            board: As `plumb.run` takes it.
            axis: The axis that `quad` estimates the tilt about. Only for recordings in units.
            period_s: Period of a step, 0.0005 to 0.1 s; None: the recording's own, of `phone` 0.01 s. Only for
                recordings in units.
            seconds: Only so much of the beginning; None: all of it.
            link: Link to board `virtual`.
            image: Flash image of board `virtual`.

        Returns:
            The arrays of the run and the verdict; `metrics` has the error where the recording has a reference.

        Raises:
            UsageError: A system that makes no inputs of recordings, or a name or a number that cannot be; of a log:
                another system, or a period, which it has already.
            LinkError: The board does not answer, or no step of a log can be reproduced.
        """
        if axis not in ("x", "y", "z"):
            raise UsageError(f"'{axis}' is no axis; use x, y or z")
        arguments.require_text(system=system, board=board)
        arguments.require_number(period_s=period_s, seconds=seconds)
        arguments.require_link(link)
        run_on = self._prepared(system, axis, period_s, seconds)
        with open_board(board, link=link, image=arguments.optional_path_of("image", image)) as opened:
            return RunResult(run_on(opened, board, link if board == "virtual" else None))

    def _prepared(
        self, system: str | None, axis: Literal["x", "y", "z"], period_s: float | None, seconds: float | None
    ) -> Callable[[StepBoard, str, str | None], ScenarioRun]:
        """Check the arguments, and return the run; it takes the board, its name, and the link to show with it."""
        if period_s is not None and not 0.0005 <= period_s <= 0.1:
            raise UsageError(f"period_s = {period_s:g}: a period is from 0.0005 to 0.1 s")
        period_us = None if period_s is None else round(period_s * 1e6)
        request = replay.ReplayRequest(self.path, axis, period_us, seconds)
        return replay.prepare(system or systems.default_for("replay"), request).run
