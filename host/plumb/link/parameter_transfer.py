"""Transfer of the parameter table over the link: read it, or stage another and commit it by its CRC-32."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

from plumb.errors import LinkError, UsageError
from plumb.link.identity import Identity, NackError, nack_error
from plumb.link.listening import Listening
from plumb.link.retries import IN_FLIGHT, REPLY_TIMEOUT_S, TRIES, LinkCounters
from plumb.spec import declarations, images, parameters
from plumb.spec import protocol as dbc_protocol
from plumb.spec.protocol import Frame, Message


class Conversation(Protocol):
    """The methods of Session that the transfer uses; Session documents them."""

    protocol: dbc_protocol.Protocol
    identity: Identity | None
    counters: LinkCounters
    listening: Listening

    def frame(self, name: str, *words: int, flags: int = 0) -> Frame: ...
    def send(self, frames: Sequence[Frame]) -> None: ...
    def receive(self, timeout_s: float) -> list[Frame]: ...
    def connect(self) -> Identity: ...
    def require_match(self) -> Identity: ...
    def end(self) -> int: ...
    def request(
        self, name: str, *words: int, answer: str = "ACK", first: int | None = None, flags: int = 0
    ) -> dict[str, int]: ...


class ParameterTransfer:
    """uploaded: the system of the table that this session last committed or read; None while unknown. table: the whole
    table that it last committed or read; None while unknown. at_arming: that table when this session armed the
    board."""

    def __init__(self, session: Conversation) -> None:
        self._session = session
        self.uploaded: str | None = None
        self.table: tuple[int, ...] | None = None
        self.at_arming: tuple[int, ...] | None = None
        self._wiring: dict[str, int] | None = None

    def read(self) -> list[int]:
        """Every parameter in use as the table's integers; unsigned for a number without a row in this version. Raises
        LinkError if some do not arrive."""
        identity = self._session.identity or self._session.connect()
        count, message = identity["PARAMETER_COUNT"], self._session.protocol["PARAM_VALUE"]
        values: dict[int, int] = {}
        fruitless = 0  # requests that brought nothing new: a slow board may need many that bring a part
        while fruitless < TRIES:
            known = len(values)
            self._session.send([self._session.frame("PARAM_GET", 0xFFFF, 0)])
            self._collect(message, values, range(count))
            fruitless = 0 if len(values) > known else fruitless + 1
            if len(values) == count:
                rows = parameters.table()
                words = [rows[i].from_word(values[i]) if i < len(rows) else values[i] for i in range(count)]
                self.table = tuple(words)
                return words
            self._session.counters.repeated_requests += 1
        raise LinkError(f"only {len(values)} of {count} parameters came back: check the cable")

    def system(self) -> str:
        """The system of the table last uploaded; otherwise of the board's first parameter, read once."""
        if self.uploaded is None:
            number = self._session.request("PARAM_GET", 0, 0, answer="PARAM_VALUE", first=0)["value"]
            self.uploaded = declarations.name_of(number)
        return self.uploaded

    def _collect(self, message: Message, values: dict[int, int], wanted: Collection[int]) -> None:
        """Collect (index, value) frames into `values` until every wanted index has arrived, or the reply time-out
        passes without a new one."""
        nack = self._session.protocol["NACK"]
        missing = {index for index in wanted if index not in values}
        reply = self._session.listening.timeout(REPLY_TIMEOUT_S)
        while missing and not reply.over:
            frames = self._session.receive(REPLY_TIMEOUT_S)
            for identifier, data in frames:
                if identifier == message.identifier:
                    index, value = message.unpack(data)[2:]
                    values[index] = value
                    missing.discard(index)
                    reply.renew()
                elif identifier == nack.identifier and nack.decode(data)["request"] in (
                    self._session.protocol["PARAM_SET"].identifier,
                    self._session.protocol["PARAM_GET"].identifier,
                ):
                    raise nack_error(self._session.protocol, nack.decode(data), self._session.identity)

    def upload(self, control_words: Sequence[int], **link_words: int) -> int:
        """Stage the whole table and commit it by its CRC-32. Returns the CRC. Ends a run in progress, armed or not, if
        the board does not let it go on with this table (`change` keeps an armed one).

        control_words: the control part in order. link_words: parameters of the link's part, such as period_us; the
        others get their defaults, except parameters.WIRING, which stay as the board has them. Raises UsageError for a
        value that is out of range or that contradicts another, LinkError if the board does not answer.
        """
        identity = self._session.require_match()
        words = parameters.whole_table(control_words, **{**self._read_wiring(), **link_words})
        wanted = declarations.name_of(words[0])
        if wanted not in identity.systems:
            raise UsageError(images.lacking(wanted, identity.systems))
        return self._transfer(words, range(len(words)), ends=("BUSY", "ARMED", "OWNER"))

    def change(self, before: Sequence[int], words: Sequence[int]) -> int:
        """Stage the words that differ, and commit the whole table by its CRC-32. Returns the CRC. before: the table in
        use, as it was just read.

        A run in real time goes on if nothing but live parameters change; while it is armed, each to at most twice and
        at least half of what it was at arming. Another run ends, unless it is armed: then NackError ARMED has the first
        word that the board refuses, and OWNER says that the run belongs to another link or to the arm switch. Raises as
        `upload`, too.
        """
        self._session.require_match()
        return self._transfer(words, [i for i, word in enumerate(words) if word != before[i]], ends=("BUSY",))

    def _transfer(self, words: Sequence[int], first: Collection[int], ends: Collection[str]) -> int:
        """Stage the words of these indices first, and the whole table when that was not enough. ends: refusals at which
        the run is ended."""
        crc = parameters.crc32(words)
        indices = first
        for _ in range(TRIES):
            self._stage({index: words[index] & 0xFFFFFFFF for index in indices})
            try:
                self.commit(len(words), crc, ends)
            except NackError as error:
                if error.reason == "PARAMETERS":
                    why = parameters.contradiction(words) or "see the limits in docs/reference/arithmetic"
                    raise UsageError(f"{error}: {why}") from None
                if error.reason != "CRC":
                    raise
                indices = range(len(words))
                continue
            self.uploaded = declarations.name_of(words[0])
            rows = parameters.table()
            self.table = tuple(row.from_word(word & 0xFFFFFFFF) for row, word in zip(rows, words, strict=True))
            self._wiring = None if self._wiring is None else {name: words[i] for i, name in self._wiring_places()}
            return crc
        raise LinkError("the parameters did not arrive as they were sent: check the cable")

    def forget(self) -> None:
        """Drop what is known of the board's parameters, after a command that changed them."""
        self.uploaded = self.table = self._wiring = None

    def _wiring_places(self) -> list[tuple[int, str]]:
        return [(i, row.name) for i, row in enumerate(parameters.table()) if row.name in parameters.WIRING]

    def _read_wiring(self) -> dict[str, int]:
        """The board's values of parameters.WIRING, read once."""
        if self._wiring is None:
            self._wiring = {
                name: self._session.request("PARAM_GET", place, 0, answer="PARAM_VALUE", first=place)["value"]
                for place, name in self._wiring_places()
            }
        return self._wiring

    def _stage(self, words: dict[int, int]) -> None:
        message = self._session.protocol["PARAM_STAGED"]
        for _ in range(2 * TRIES):
            echoed: dict[int, int] = {}
            indices = list(words)
            for at in range(0, len(indices), IN_FLIGHT):
                part = indices[at : at + IN_FLIGHT]
                self._session.send([self._session.frame("PARAM_SET", index, words[index]) for index in part])
                self._collect(message, echoed, part)
            words = {index: word for index, word in words.items() if echoed.get(index) != word}
            if not words:
                return
            self._session.counters.repeated_requests += len(words)
        raise LinkError("not every parameter was acknowledged: check the cable")

    def commit(self, count: int, crc: int, ends: Collection[str] = ("BUSY",)) -> None:
        """Commit the staged table; a refusal of `ends` ends the run in progress, and is tried again. Raises
        NackError."""
        try:
            self._session.request("PARAM_COMMIT", count, crc)
        except NackError as error:
            if error.reason not in ends:
                raise
            self._session.end()
            self._session.request("PARAM_COMMIT", count, crc)
