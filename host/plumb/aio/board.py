"""`plumb.aio.connect`: a board as an asynchronous context manager."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
from collections.abc import AsyncIterator, Callable, Mapping
from types import TracebackType
from typing import Any, ParamSpec, Self

from plumb.aio.link_thread import CLOSED, LinkThread
from plumb.aio.parameters import Parameters
from plumb.aio.samples import Samples
from plumb.api import connection
from plumb.api.live import BoardIdentity
from plumb.errors import LinkError, UsageError

Options = ParamSpec("Options")


class Board:
    """A board in an event loop; `connect` makes it. An asynchronous context manager: leaving it, also by an exception,
    a cancelled task or Ctrl-C, disarms the board, ends the run and closes the link.

    Attributes:
        name: The board as it was named.
    """

    def __init__(
        self,
        name: str,
        open_: Callable[[Callable[[str], None] | None], connection.Board],
        on_lost: Callable[[str], None] | None,
    ) -> None:
        self.name = name
        self._open, self._on_lost = open_, on_lost
        self._thread: LinkThread | None = None

    async def __aenter__(self) -> Self:
        if self._thread is not None:
            raise UsageError(f"{self.name} was opened before: connect again")
        loop, on_lost = asyncio.get_running_loop(), self._on_lost

        def lost(reason: str) -> None:
            """In the loop, not in the thread of the link."""
            if on_lost is not None and not loop.is_closed():
                loop.call_soon_threadsafe(on_lost, reason)

        self._thread = LinkThread(loop, lambda: self._open(None if on_lost is None else lost))
        self._thread.start()
        try:
            await self._thread.open()
        except BaseException:
            self._thread.leave()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        thread = self._link()
        thread.hold(None)
        closing = asyncio.ensure_future(thread.ask(thread.close))
        try:
            await asyncio.shield(closing)
        except UsageError:
            pass  # its thread has ended, and closed it
        except LinkError:
            if error is None:  # else the error that is under way says more
                raise

    def __repr__(self) -> str:
        return f"<aio.Board {self.name}>"

    def _link(self) -> LinkThread:
        if self._thread is None:
            raise UsageError(CLOSED)
        return self._thread

    async def identity(self) -> BoardIdentity:
        """The identity of the board. Raises LinkError when it does not answer."""
        return await self._link().ask(lambda board: board.identity)

    @property
    def params(self) -> Parameters:
        """The parameters in use, in units: `await board.params.set("pid.kp", 0.05)`."""
        return Parameters(self._link())

    def stream(self, seconds: float | None = None, *, begin: bool = True) -> Samples:
        """Samples of the board on its own sensors, in real time, one a step: `async for sample in board.stream()`.

        Arguments, and what happens when the board is lost, are those of `plumb.Board.stream`. One stream is open at a
        time; it ends with its loop. A task that leaves samples of 0.5 s untaken counts as one that hangs: no more is
        received until it takes them, and an armed board disarms. A simulated board waits for the task at every sample.

        Raises:
            UsageError: A board without a link, or a stream that is open already.
            LinkError: As `plumb.Board.stream`.
        """
        return Samples(self._link(), seconds, begin)

    async def arm(self) -> None:
        """Arm the board for the task that calls this: its outputs drive the actuators from here on. A run on its own
        sensors is begun if none is on.

        The board stays armed while this task has not ended, the event loop runs, and the samples of an open stream are
        taken. It is disarmed by `disarm`, when the task ends in whatever way, when the loop is blocked for about
        40 ms, when the board is closed, and with the process. A task that waits for something that never comes, in a
        loop that runs, without a stream, is no hang that can be seen: use `asyncio.timeout`.

        Raises:
            UsageError: A board without a link, or armed for another task.
            LinkError: The board refuses; the sentence says what is in the way.
        """
        thread, task = self._link(), asyncio.current_task()
        assert task is not None  # a coroutine runs in a task
        if thread.holder not in (None, task):
            raise UsageError("another task has armed this board: one task holds it at a time")
        thread.hold(task)
        task.add_done_callback(self._task_ended)
        try:
            await thread.ask(thread.arm)
        except BaseException:
            self._let_go(thread)
            raise

    async def disarm(self) -> None:
        """Disarm the board: its outputs are neutral. The run goes on. A cancelled task disarms all the same.

        Raises:
            UsageError: A board without a link.
            LinkError: The board does not answer.
        """
        thread = self._link()
        thread.hold(None)
        await asyncio.shield(asyncio.ensure_future(thread.ask(thread.disarm)))

    @contextlib.asynccontextmanager
    async def armed(self) -> AsyncIterator[Self]:
        """`async with board.armed():` arms as `arm`, and disarms at the end of the block, however it is left.

        Raises:
            UsageError: As `arm`.
            LinkError: As `arm`, and at the end when the board does not answer.
        """
        await self.arm()
        try:
            yield self
        except BaseException:
            with contextlib.suppress(LinkError):  # the error that is under way says more
                await self.disarm()
            raise
        await self.disarm()

    async def set_setpoint(self, value: float) -> None:
        """Give the run its setpoint, as `plumb.Board.set_setpoint`; it is repeated while the board is armed.

        Raises:
            UsageError: A value that the setpoint cannot hold, a system without one, or no run.
            LinkError: The link takes no data.
        """
        await self._link().ask(lambda board: board.set_setpoint(value))

    async def set_commands(self, values: Mapping[str, float]) -> None:
        """Set the commands of the run, all at once, as `plumb.Board.set_commands`.

        Raises:
            UsageError: An unknown name, a value beyond its limits, or no run.
            LinkError: The link takes no data.
        """
        await self._link().ask(lambda board: board.set_commands(values))

    def _task_ended(self, task: asyncio.Task[object]) -> None:
        thread = self._link()
        if thread.holder is task:
            self._let_go(thread)

    @staticmethod
    def _let_go(thread: LinkThread) -> None:
        """No keep-alive from this moment on, and the command to disarm, which nobody waits for."""
        thread.hold(None)
        thread.post(thread.disarm)


def _options_of(
    original: Callable[Options, connection.Board],
) -> Callable[[Callable[..., Board]], Callable[Options, Board]]:
    """Give a function the arguments of another, names and defaults, for type checkers and for `help`."""

    def with_options(function: Callable[..., Board]) -> Callable[Options, Board]:
        described = inspect.signature(original).replace(return_annotation="Board")
        function.__signature__ = described  # type: ignore[attr-defined]
        return function

    return with_options


@_options_of(connection.connect)
def connect(
    board: str,
    *,
    on_lost: Callable[[str], None] | None = None,
    **options: Any,  # Any: as `plumb.connect` says of each
) -> Board:
    """A board for `async with`, which opens it. The arguments are those of `plumb.connect`; `on_lost` is called in the
    event loop.

    Returns:
        The board; use it in an `async with` statement, which raises UsageError and LinkError as `plumb.connect`.
    """
    inspect.signature(connection.connect).bind(board, **options)  # a wrong name raises here, not when it is opened
    if on_lost is not None and not callable(on_lost):
        raise UsageError("on_lost: give a function")

    def open_(lost: Callable[[str], None] | None) -> connection.Board:
        return connection.connect(board, on_lost=lost, **options)

    return Board(str(board), open_, on_lost)
