"""The thread that owns a board: it does what the event loop asks for, one request after the other, and receives in
between while a stream or an armed board needs it.

A board is kept armed only while the event loop lives and the task that armed has not ended: for every keep-alive value
of the board this thread asks the loop, and answers only after the loop has answered. A loop that is blocked, stopped or
closed is silence for the board from that moment on, as a host that hangs.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import queue
import threading
from collections.abc import Callable, Generator
from typing import Protocol, TypeVar

from plumb.api.connection import Board
from plumb.api.live import Sample
from plumb.boards.contract import SimulatedBoard
from plumb.errors import PlumbError, UsageError

T = TypeVar("T")

LOOP_ANSWERS_S = 0.02
"""Longest wait for the event loop before a keep-alive value stays without an answer. The board waits for 40 ms."""
LOOK_S = 0.01
"""Longest time without a look at the requests while an armed board is listened to."""
IDLE_LOOK_S = 0.2
"""The same while there is nothing to receive: interval at which a loop that was closed is noticed."""
BEHIND_S = 0.5
"""A task that has left samples of so much time untaken hangs: nothing more is read, and an armed board disarms."""
FULL_LOOK_S = 0.001
"""Interval at which a stream whose samples nobody takes looks whether that has changed."""
CLOSED = "the board is closed, or was not opened: use `async with plumb.aio.connect(...) as board`"
EXIT_S = 3.0
"""Longest wait for the thread when the program ends."""


class StreamEnded(BaseException):
    """Ends a stream that waits for a lost board. No error: nobody catches it on the way."""


class Sink(Protocol):
    """Receiver of samples. dropped: no task can take them any more. most_behind_s: time between the last sample that
    was taken and the newest one, from which on it is full. count: called here with a sample that is on its way; put:
    called in the loop with a sample, with the error that ends the stream, or with None for its end."""

    dropped: bool
    most_behind_s: float

    def full(self) -> bool: ...
    def count(self, sample: Sample) -> None: ...
    def put(self, item: Sample | BaseException | None) -> None: ...


class LinkThread(threading.Thread):
    """open_: opens the board, in this thread."""

    def __init__(self, loop: asyncio.AbstractEventLoop, open_: Callable[[], Board]) -> None:
        super().__init__(name="plumb link", daemon=True)
        self._loop, self._open = loop, open_
        self._requests: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._board: Board | None = None
        self._samples: Generator[Sample, None, None] | None = None
        self._sink: Sink | None = None
        self._receiving: Sink | None = None
        """The sink of the stream whose next sample is waited for: meanwhile it cannot be closed."""
        self._holder: asyncio.Task[object] | None = None
        self._most_behind_s = BEHIND_S
        self._leaving = False
        self._gate = threading.Lock()
        self._ended = False

    # ---- called in the event loop ----

    async def ask(self, what: Callable[[Board], T]) -> T:
        """Do this with the board and give its result. A request that is cancelled before its turn is not done; one
        that has begun is done to its end. Raises UsageError when the board is closed."""
        return await self._ask(lambda: what(self._opened()))

    async def open(self) -> None:
        """Open the board; the first request."""
        await self._ask(self._open_board)

    async def _ask(self, what: Callable[[], T]) -> T:
        future: asyncio.Future[T] = self._loop.create_future()
        if not self._put(lambda: self._answer(future, what)):
            raise UsageError(CLOSED)
        return await future

    def post(self, what: Callable[[Board], object]) -> None:
        """The same without a result, for an action that must happen whether a caller waits for it or not."""

        def do() -> None:
            with contextlib.suppress(PlumbError):  # a board without keep-alive disarms by itself
                what(self._opened())

        self._put(do)

    def _put(self, request: Callable[[], None]) -> bool:
        """Line up a request; False once nobody will do it."""
        with self._gate:
            if not self._ended:
                self._requests.put(request)
            return not self._ended

    def leave(self) -> None:
        """End the thread, when opening failed or nobody waits for it any more."""
        self._leaving = True

    def hold(self, task: asyncio.Task[object] | None) -> None:
        """From here on the board is kept alive for this task; None: for nobody."""
        self._holder = task

    @property
    def holder(self) -> asyncio.Task[object] | None:
        return self._holder

    # ---- this thread ----

    def run(self) -> None:
        atexit.register(self._exit)
        try:
            while not self._leaving and not self._loop.is_closed():
                self._turn()
        finally:
            with contextlib.suppress(PlumbError):
                self.close(self._board)
            with self._gate:
                self._ended = True
            while self._serve(0.0):  # the last callers get the error that the board is closed
                pass
            atexit.unregister(self._exit)

    def _open_board(self) -> None:
        board = self._open()
        self._board = board
        simulated = board.name == "native" or isinstance(board.runs_on, SimulatedBoard)
        self._most_behind_s = 0.0 if simulated else BEHIND_S  # so that two runs are the same
        board.consent = self.consent
        board.wait_with(self._pause)

    def arm(self, board: Board) -> None:
        board.arm()

    def disarm(self, board: Board) -> None:
        board.disarm()

    def close(self, board: Board | None) -> None:
        """The last request."""
        self._leaving, self._holder, self._board = True, None, None
        sink = self._sink
        self._end_stream()
        if sink is not None:
            self._post(sink.put, None)
        if board is not None:
            board.close()

    def _exit(self) -> None:
        """At the end of the program, if nobody has closed the board."""
        self.post(self.close)
        self.join(EXIT_S)

    def _turn(self) -> None:
        """A request, or else what has been received."""
        stream = self._samples is not None
        armed = self._holder is not None and self._board is not None and self._board.armed
        if self._serve(0.0 if stream or armed else IDLE_LOOK_S) or self._leaving:
            return
        if stream:
            self._receive_samples()
        elif armed and self._board is not None:
            self._listen(self._board)

    def _serve(self, wait_s: float) -> bool:
        """Do one request, waiting so long for it; whether there was one."""
        try:
            request = self._requests.get(timeout=wait_s) if wait_s else self._requests.get_nowait()
        except queue.Empty:
            return False
        request()
        return True

    def _listen(self, board: Board) -> None:
        """Keep an armed board alive while no stream takes its samples. A link that fails is found by the next
        request."""
        try:
            board.keep_alive(LOOK_S)
        except PlumbError:
            self._holder = None

    def _opened(self) -> Board:
        if self._board is None:
            raise UsageError(CLOSED)
        return self._board

    def _answer(self, future: asyncio.Future[T], what: Callable[[], T]) -> None:
        if future.cancelled():
            return
        try:
            result = what()
        except Exception as error:
            self._post(_fail, future, error)
        else:
            self._post(_settle, future, result)

    def _post(self, what: Callable[..., object], *arguments: object) -> None:
        """Call this in the event loop; a loop that was closed ends this thread."""
        try:
            self._loop.call_soon_threadsafe(what, *arguments)
        except RuntimeError:
            self._leaving = True

    # ---- samples ----

    def begin_stream(self, board: Board, sink: Sink, seconds: float | None, begin: bool) -> None:
        """Receive samples into a sink. Raises UsageError while another one is open."""
        if self._sink is sink:
            return
        if self._sink is not None and not self._sink.dropped:
            raise UsageError("a stream of this board is open already: leave that one, or share its samples")
        self._end_stream()
        sink.most_behind_s = self._most_behind_s
        self._samples, self._sink = board.stream(seconds, begin=begin), sink

    def end_stream(self, sink: Sink) -> None:
        """End the stream of this sink, if it is still open. One that waits for a lost board ends at its next look."""
        sink.dropped = True
        if self._sink is sink:
            self._end_stream()

    def _end_stream(self) -> None:
        """One whose next sample is waited for ends there, with the next look of `_pause`."""
        samples, self._samples, self._sink = self._samples, None, None
        if samples is not None and self._receiving is None:
            samples.close()

    def _receive_samples(self) -> None:
        samples, sink = self._samples, self._sink
        assert samples is not None and sink is not None
        if sink.dropped:
            self._end_stream()
            return
        if sink.full():
            self._serve(FULL_LOOK_S)
            return
        item: Sample | BaseException | None
        self._receiving = sink
        try:
            item = next(samples, None)
        except StreamEnded:
            item = None
        except Exception as error:
            item = error
        finally:
            self._receiving = None
        if isinstance(item, Sample):
            sink.count(item)
        elif self._samples is samples:
            self._end_stream()
        self._post(sink.put, item)

    def _pause(self, seconds: float) -> None:
        """While a lost board is waited for, requests go on: they fail, except those to stop."""
        self._serve(seconds)
        if self._leaving or self._loop.is_closed() or (self._receiving is not None and self._receiving.dropped):
            raise StreamEnded

    # ---- the keep-alive ----

    def consent(self) -> bool:
        """Whether the board is to be kept armed at this moment: the task that armed has not ended, and the event loop
        answers."""
        holder = self._holder
        if holder is None or holder.done():
            return False
        answered = threading.Event()
        self._post(answered.set)
        return answered.wait(LOOP_ANSWERS_S) and not holder.done()


def _settle(future: asyncio.Future[T], result: T) -> None:
    """Give a future its result in the loop, unless somebody has cancelled it."""
    if not future.done():
        future.set_result(result)


def _fail(future: asyncio.Future[T], error: Exception) -> None:
    if not future.done():
        future.set_exception(error)
