"""The samples of a board as an asynchronous iterator."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Self

from plumb.aio.link_thread import LinkThread
from plumb.api.live import Sample


class Samples(AsyncIterator[Sample]):
    """The samples of `stream`, for `async for`. It ends when the last reference to it is gone."""

    def __init__(self, thread: LinkThread, seconds: float | None, begin: bool) -> None:
        self._thread, self._seconds, self._begin = thread, seconds, begin
        self._sink = _Sink()
        self._begun = self._ended = False

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Sample:
        if self._ended:
            raise StopAsyncIteration
        if not self._begun:
            thread, sink = self._thread, self._sink
            await thread.ask(lambda board: thread.begin_stream(board, sink, self._seconds, self._begin))
            self._begun = True
        item = await self._sink.take()
        if isinstance(item, Sample):
            return item
        self._ended = True
        if item is None:
            raise StopAsyncIteration
        raise item

    async def aclose(self) -> None:
        """End the stream, and wait until it has ended."""
        if self._begun and not self._ended:
            thread, sink = self._thread, self._sink
            self._ended = sink.dropped = True
            await thread.ask(lambda _: thread.end_stream(sink))

    def __del__(self) -> None:
        self._sink.dropped = True


class _Sink:
    """A queue from the link's thread to the task that takes. The thread counts, the loop puts and takes."""

    def __init__(self) -> None:
        self.dropped = False
        self.most_behind_s = 0.0
        self._items: asyncio.Queue[Sample | BaseException | None] = asyncio.Queue()
        self._counted = self._taken = 0
        self._newest_s = self._taken_s = 0.0

    def full(self) -> bool:
        """Whether samples of more time wait than may. A new run begins at 0 s: then the next ones are let in."""
        return self._counted != self._taken and self._newest_s - self._taken_s >= self.most_behind_s

    def count(self, sample: Sample) -> None:
        if self._counted == self._taken:
            self._taken_s = sample.time_s
        self._counted += 1
        self._newest_s = sample.time_s

    def put(self, item: Sample | BaseException | None) -> None:
        self._items.put_nowait(item)

    async def take(self) -> Sample | BaseException | None:
        item = await self._items.get()
        if isinstance(item, Sample):
            self._taken_s = item.time_s
            self._taken += 1
        else:
            self._items.put_nowait(item)  # the end is for every task that waits
        return item
