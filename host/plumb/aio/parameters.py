"""`board.params` of a board in asyncio: the parameters in engineering units, by the names of its tuning."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.aio.link_thread import LinkThread
from plumb.api.parameters import ParameterDescription
from plumb.tuning.quantities import Value


class Parameters:
    """The parameters of a board in units, as `plumb.Parameters` has them: names with or without the unit, and every
    write commits the whole table. A write that is cancelled after it has begun is done to its end."""

    def __init__(self, thread: LinkThread) -> None:
        self._thread = thread

    async def get(self, name: str) -> Value:
        """The value of one parameter. Raises UsageError for a name that there is not, LinkError."""
        return await self._thread.ask(lambda board: board.params[name])

    async def set(self, name: str, value: Value) -> None:
        """Write one parameter. Raises UsageError, with the limit, for a value that the board could not hold, and
        LinkError."""
        await self.update({name: value})

    async def update(self, values: Mapping[str, Value]) -> None:
        """Write several parameters with one commit. Raises as `set`; nothing is changed then."""
        await self._thread.ask(lambda board: board.params.update(values))

    async def read(self) -> dict[str, Value]:
        """All parameters by their whole names, with one transfer. Raises LinkError."""
        return await self._thread.ask(lambda board: board.params.read())

    async def describe(self, name: str) -> ParameterDescription:
        """Unit, value, limits and meaning of a parameter. Raises UsageError, LinkError."""
        return await self._thread.ask(lambda board: board.params.describe(name))

    async def save(self) -> None:
        """Write the parameters in use to the board's flash, which it loads at every start. Raises LinkError."""
        await self._thread.ask(lambda board: board.params.save())
