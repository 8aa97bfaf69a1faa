"""`plumb.connect`: a board, its parameters in units, runs in lockstep, and its own sensors live."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal, NamedTuple, Self

from plumb.api import arguments, given_inputs
from plumb.api.live import BoardIdentity, Sample, SampleStream
from plumb.api.parameters import Parameters
from plumb.api.reconnection import AnotherBoardError, Before, Found, Reconnection
from plumb.api.runs import RunResult, request_of, run_own
from plumb.boards import contract, open_board, open_link_board, plant_on_pins
from plumb.boards.contract import SimulatedBoard
from plumb.boards.link import LinkBoard
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.link import monitor
from plumb.link.discovery import resolved
from plumb.link.identity import NackError
from plumb.process_signals import endings, raise_ending
from plumb.proof import scenario_run
from plumb.spec import declarations
from plumb.spec.parameter_file import by_name
from plumb.version import installed

if TYPE_CHECKING:
    import numpy.typing as npt

    from plumb.link.session import Session
    from plumb.spec.tuning import AnyTuning


class PlantAsked(NamedTuple):
    """The plant on the sensors of a simulated board. None: the first system, the system's own scenario."""

    system: str | None
    scenario: str | None
    seed: int
    open_loop: bool


class Board:
    """An open board; `connect` makes it. A context manager: leaving it, by an exception or Ctrl-C, too, disarms the
    board, ends the run and closes the link.

    A simulated board (`native`, `virtual`) has a plant on its sensors, and its time passes only while something waits
    for it: in `run`, `stream`, `arm` and the parameters. Between the samples of a `stream` from a real board that is
    armed, the program has about 30 ms: it has to keep the board alive.

    Attributes:
        name: The board as it was named.
        runs_on: The board of `plumb.boards` behind it, for the modules of `plumb.proof`.
        consent: Asked before every keep-alive of a board that is armed from then on, if it is not None; while it says
            False, the board is left to disarm itself.
    """

    def __init__(
        self,
        name: str,
        runs_on: contract.StepBoard,
        link: str,
        plant: PlantAsked,
        reconnection: Reconnection | None = None,
    ) -> None:
        self.name = name
        self.runs_on = runs_on
        self.consent: Callable[[], bool] | None = None
        self._link, self._plant, self._reconnection = link, plant, reconnection
        self._talks_to: LinkBoard | None = runs_on if isinstance(runs_on, LinkBoard) else None
        self._attached = False
        self._live = False
        self._closed = False
        self._params: Parameters | None = None
        self._last: Sample | None = None
        self._received_s = time.monotonic()
        self._period_s = 1.0

    def __enter__(self) -> Self:
        if self._closed:
            raise UsageError(f"{self.name} is closed: connect again")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(LinkError):  # the error that is under way says more
            self.close()

    def __repr__(self) -> str:
        return f"<Board {self.name}{', closed' if self._closed else ''}>"

    def close(self) -> None:
        """Disarm, end the run and close the link; may be called twice. Ctrl-C waits until that is done.

        Raises:
            LinkError: The board does not answer; the link is closed all the same.
        """
        if self._closed:
            return
        self._closed = True
        on_main = threading.current_thread() is threading.main_thread()
        deferred: contextlib.AbstractContextManager[list[int]] = endings() if on_main else contextlib.nullcontext([])
        with deferred as caught:
            try:
                if self._talks_to is not None and self._live:
                    self._live = False
                    self._talks_to.session.listener = None
                    self._talks_to.session.end()
            finally:
                if self._talks_to is not None:
                    self._talks_to.close()
                self.runs_on.close()
        if caught:
            raise_ending(caught)

    # ---- who it is, and its parameters ----

    @property
    def identity(self) -> BoardIdentity:
        """The identity of the board. Raises LinkError when it does not answer."""
        if self._talks_to is None and self.name != "native":
            return BoardIdentity(installed().version, "", declarations.names())
        said = self._session().connect()
        return BoardIdentity(
            installed().version, said.git_hash, said.systems, said.unique_id, said.parameter_source, said.mismatch
        )

    @property
    def params(self) -> Parameters:
        """The parameters in use, in units: `board.params["pid.kp"] = 0.05`. Raises UsageError for a board without a
        link."""
        session = self._session()
        if self._params is None:
            self._params = Parameters(session)
        self._params.move_to(session)
        return self._params

    # ---- runs in lockstep ----

    def run(
        self,
        system: str,
        *,
        scenario: str | None = None,
        seed: int = 1000,
        tuning: str | AnyTuning | None = None,
        start: str | None = None,
        seconds: float | None = None,
        faults: Sequence[str] = (),
        conditions: Mapping[str, float] | None = None,
        open_loop: bool = False,
        live: bool = False,
        raw: npt.ArrayLike | None = None,
        setpoint: npt.ArrayLike | None = None,
        gyr_radps: npt.ArrayLike | None = None,
        acc_mps2: npt.ArrayLike | None = None,
        ang_radps2: npt.ArrayLike | None = None,
        period_s: float | None = None,
    ) -> RunResult:
        """Run a system on this board, and compare every step with the integer model.

        The board gets the run's parameters, and keeps them. The inputs are a scenario, raw counts, or samples of a
        body's sensors.

        Args:
            system: Name of a system.
            scenario: As `plumb.run` takes it.
            seed: As `plumb.run` takes it.
            tuning: As `plumb.run` takes it.
            start: As `plumb.run` takes it.
            seconds: As `plumb.run` takes it.
            faults: As `plumb.run` takes it.
            conditions: As `plumb.run` takes it.
            open_loop: As `plumb.run` takes it.
            live: As `plumb.run` takes it.
            raw: Raw counts of your own, (N, 3 to 6) integers of 16 bits, instead of a scenario.
            setpoint: Setpoints with `raw`, (N,) in the integers of the system; None: 0.
            gyr_radps: Angular rate, (N, 3) rad/s, instead of a scenario; `plumb.Estimator` says what is used of it.
            acc_mps2: Specific force, (N, 3) m/s^2, with `gyr_radps`.
            ang_radps2: Angular acceleration, (N, 3) rad/s^2, with `gyr_radps`.
            period_s: Period of inputs of your own; None: the tuning's.

        Returns:
            The arrays of the run and the verdict.

        Raises:
            UsageError: A name that does not exist, inputs of a wrong shape, or two kinds of inputs.
            LinkError: The board does not answer.
        """
        if self._closed:
            raise UsageError(f"{self.name} is closed: connect again")
        self._live = False
        own = raw is not None or gyr_radps is not None
        if not own and any(one is not None for one in (setpoint, acc_mps2, ang_radps2, period_s)):
            raise UsageError("setpoint, acc_mps2, ang_radps2 and period_s go with raw or gyr_radps")
        if own and (scenario or start or faults or conditions or open_loop or live or seconds is not None):
            raise UsageError("a run is of a scenario, or of inputs of your own")
        if raw is not None and gyr_radps is not None:
            raise UsageError("give raw or gyr_radps, not both")
        if not own:
            request = request_of(
                system,
                self.name,
                scenario,
                seed,
                tuning,
                start,
                seconds,
                faults,
                conditions,
                open_loop,
                live,
                self._link,
            )
            return RunResult(scenario_run.perform(request, self.runs_on))
        from plumb.api.estimator import Estimator, at_period

        if gyr_radps is not None:
            estimator = Estimator(system, tuning, period_s=period_s)
            counts = estimator.counts(gyr_radps, acc_mps2, ang_radps2=ang_radps2)
            return run_own(self.runs_on, self.name, estimator.params, counts, setpoint)
        assert raw is not None
        _, settings = scenario_run.tuning_of(system, tuning)
        return run_own(self.runs_on, self.name, quantise(at_period(settings, period_s)), raw, setpoint)

    # ---- live ----

    def stream(self, seconds: float | None = None, *, begin: bool = True) -> Generator[Sample, None, None]:
        """Samples of the board on its own sensors, in real time, one a step.

        A board that was connected with `reconnect` and is lost makes a pause, and no exception: the first sample
        after it has a `gap`. The run goes on where the board kept it; a board that was restarted begins another one.
        It is never armed again by itself.

        Args:
            seconds: For so many seconds of the board's time; with `reconnect`, of this computer's, pauses included;
                None: until you leave the loop.
            begin: Begin a run where none of this object is on. False: only listen to a run that another program
                began; its selection says which signals come.

        Yields:
            A sample for every step. The run goes on when you leave the loop, until the board is closed.

        Raises:
            UsageError: A board without a link.
            LinkError: The board does not answer, or falls silent; with `reconnect`: it did not come back in time,
                another board answers in its place, or another program has begun a run on it.
        """
        arguments.require_number(seconds=seconds)
        if seconds is not None and not seconds > 0:
            raise UsageError(f"seconds = {seconds:g}: ask for more than nothing")
        self._session()
        if self._reconnection is not None:
            yield from self._stream_on(self._reconnection, seconds, begin)
            return
        first_s: float | None = None
        for sample in self._samples(begin):
            first_s = sample.time_s if first_s is None else first_s
            if seconds is not None and sample.time_s - first_s >= seconds - 1e-9:
                return
            yield sample

    def _samples(self, begin: bool, near: int = 0) -> Iterator[Sample]:
        """Samples over one connection."""
        session = self._session()
        table = by_name(session.read_parameters())
        self._period_s = table["period_us"] * 1e-6
        stream = SampleStream(session, declarations.name_of(table["system"]), self._period_s, near)
        session.listener = stream.feed
        try:
            if begin:
                self._begin()
            for sample in stream.samples():
                self._last, self._received_s = sample, time.monotonic()
                yield sample
        finally:
            session.listener = None

    def _stream_on(self, reconnection: Reconnection, seconds: float | None, begin: bool) -> Iterator[Sample]:
        """Samples over one connection after the other."""
        if begin:
            self._session().require_match()
        end_s = None if seconds is None else time.monotonic() + seconds
        lost: tuple[Before, Found] | None = None
        while True:
            near = lost[0].near() if lost is not None and lost[1].goes_on else 0
            try:
                for sample in self._samples(begin, near):
                    if lost is not None:
                        sample, lost = replace(sample, gap=lost[1].gap(lost[0], sample)), None
                    if end_s is not None and time.monotonic() >= end_s:
                        return
                    yield sample
            except (NackError, AnotherBoardError):
                raise
            except LinkError as error:
                before = self._before(str(error)) if lost is None else lost[0].still(self._before(str(error)))
                found = self._find_again(reconnection, before, end_s)
                if found is None:
                    return
                lost = before, found

    def _before(self, reason: str) -> Before:
        """State of a board at the moment of its loss."""
        session, last = self._session(), self._last
        assert session.identity is not None
        step, armed = (None, False) if last is None else (last.step, last.armed)
        tag = session.run_tag if self._live else None
        table = session.parameters.table
        return Before(reason, session.identity, table, tag, step, armed, self._received_s, self._period_s)

    def _find_again(self, reconnection: Reconnection, before: Before, end_s: float | None) -> Found | None:
        """Close what is left of the link, and put the board in its place that is found."""
        assert self._talks_to is not None
        self._live = False
        with contextlib.suppress(LinkError):
            self._talks_to.close()
        if (found := reconnection.find(self.name, before, end_s)) is not None:
            self.runs_on = self._talks_to = found.board
            self._live = found.goes_on and before.run_tag is not None
            found.board.session.run_tag = before.run_tag or 0
            if self._params is not None:
                self._params.move_to(found.board.session)
        return found

    def arm(self) -> None:
        """Arm the board: its outputs drive the actuators from here on. A run on its own sensors is begun if none is on.

        An armed board needs a keep-alive of this program every 40 ms: go on with `stream`, or with `keep_alive`.

        Raises:
            UsageError: A board without a link.
            LinkError: The board refuses; the sentence says what is in the way.
        """
        session = self._session()
        session.consent = self.consent
        self._begin()
        session.arm()

    @property
    def armed(self) -> bool:
        """Whether this object has armed the board, and nothing that the board said shows that this is over."""
        return self._talks_to is not None and self._talks_to.session.armed

    def keep_alive(self, seconds: float) -> None:
        """Keep an armed board alive for so many seconds of its time, while you take no samples.

        Raises:
            UsageError: A board without a link.
            LinkError: The link fails.
        """
        session = self._session()
        end_s = session.clock() + seconds
        while (left_s := end_s - session.clock()) > 0:
            session.receive(left_s)

    def wait_with(self, pause: Callable[[float], None]) -> None:
        """Call this with the seconds of every pause between two attempts to reach a lost board; it may raise."""
        if self._reconnection is not None:
            self._reconnection.pause = pause

    def disarm(self) -> None:
        """Disarm the board: its outputs are neutral. The run goes on.

        Raises:
            UsageError: A board without a link.
            LinkError: The board does not answer.
        """
        self._session().disarm()

    def set_setpoint(self, value: float) -> None:
        """Give the run that is on its setpoint, in the unit of its system: deg for `quad`, m/s for `balancer`.

        The board takes it as far as its parameters allow. While this object keeps the board armed, `stream` repeats
        it; a setpoint that is not repeated for 200 ms counts as 0.

        Raises:
            UsageError: A value that is no number or that the integer of the setpoint cannot hold, a system without a
                setpoint, or no run.
            LinkError: The link takes no data.
        """
        arguments.require_number(value=value)
        given_inputs.set_setpoint(self._session(), value, live=self._live)

    def set_commands(self, values: Mapping[str, float]) -> None:
        """Set the commands of the run, all at once, in the units of the system's declaration (deg for an angle).

        Commands that are not given get the value that they have when nothing sets them. They come with the setpoint
        that was set last, and count as it does (`set_setpoint`).

        Raises:
            UsageError: An unknown name, a value beyond its limits, or no run.
            LinkError: The link takes no data.
        """
        given_inputs.set_commands(self._session(), values, live=self._live)

    def _begin(self) -> None:
        if not self._live:
            monitor.begin_live(self._session())
            self._live, self._last = True, None

    def _session(self) -> Session:
        """The session with the board; a simulated board gets its plant first."""
        if self._closed:
            raise UsageError(f"{self.name} is closed: connect again")
        system, scenario, seed, open_loop = self._plant
        if self.name == "native" and self._talks_to is None:
            from plumb.boards.native.port import NativePort

            name = system or declarations.names()[0]
            _, plant = plant_on_pins.plant_of(name, scenario, seed, open_loop=open_loop)
            self._talks_to = NativePort(name, plant)
        if self._talks_to is None:
            raise UsageError(f"{self.name} has no link: it runs vectors and scenarios alone; use native or virtual")
        if self.name == "virtual" and not self._attached:
            self._attached = True
            assert isinstance(self._talks_to, SimulatedBoard)
            name = system or self._talks_to.session.system
            plant_on_pins.show(self._talks_to, name, scenario, seed, open_loop=open_loop)
        return self._talks_to.session


def connect(
    board: str,
    *,
    link: Literal["serial", "can"] = "serial",
    image: Path | str | None = None,
    system: str | None = None,
    scenario: str | None = None,
    seed: int = 1000,
    open_loop: bool = True,
    reconnect: bool | float = False,
    on_lost: Callable[[str], None] | None = None,
) -> Board:
    """Open a board.

    Args:
        board: `native`, `qemu`, `virtual`, `serial:PORT[@BAUD]`, `can:INTERFACE:CHANNEL[@KBIT]`, or `auto` for the only
            board that is here, as `--board` of the command line. `native` runs scenarios on the C core, and has a link
            to the whole main loop in this process.
        link: Link to board `virtual`.
        image: Flash image of board `virtual`; None: the one that was built or installed.
        system: System that a simulated board comes up as, with its plant on the sensors; None: the first.
        scenario: Scenario of that plant; None: the system's own.
        seed: Seed of that plant.
        open_loop: The plant follows its scenario. False: the outputs of the board move it.
        reconnect: What `stream` does when a board over serial or CAN is lost. False: it raises LinkError. True: it
            waits for the board, without limit. A number: it waits so many seconds at most. Everything else
            (parameters, `arm`, `disarm`) raises LinkError while the board is away, and is not repeated.
        on_lost: With `reconnect`: called with the reason, a sentence, when the board is lost.

    Returns:
        The board; use it in a `with` statement.

    Raises:
        UsageError: A name that does not exist, or a tool or an image that is missing.
        LinkError: The board does not answer.
    """
    if not isinstance(board, str):
        raise UsageError(f"board = {arguments.shown(board)}: give the name of a board")
    arguments.require_text(system=system, scenario=scenario)
    arguments.require_whole(seed=seed)
    arguments.require_link(link)
    if not isinstance(reconnect, bool):
        arguments.require_number(reconnect=reconnect)
        if reconnect is None or not reconnect > 0:
            raise UsageError(
                f"reconnect = {arguments.shown(reconnect)}: give True, or the seconds to wait for the board"
            )
    if on_lost is not None and not callable(on_lost):
        raise UsageError(f"on_lost = {arguments.shown(on_lost)}: give a function")
    plant = PlantAsked(system, scenario, seed, open_loop)
    if system is not None:
        declarations.system(system)
    if (system or scenario) and board not in ("native", "virtual"):
        raise UsageError(f"system and scenario are for native and virtual, on which a plant is put, not for {board}")
    name = resolved(board)
    opened = open_board(name, link=link, image=arguments.optional_path_of("image", image))
    if reconnect is False:
        return Board(name, opened, link, plant)
    if not isinstance(opened, LinkBoard) or isinstance(opened, SimulatedBoard):
        opened.close()
        raise UsageError(f"reconnect is for a board over serial or CAN: {name} is never lost")
    patience_s = None if reconnect is True else float(reconnect)
    return Board(name, opened, link, plant, Reconnection(lambda: open_link_board(name), patience_s, on_lost))
