"""pytest plugin: golden vectors as tests, and a board as a fixture. It is there once plumb is installed.

    pytest --plumb-golden --plumb-board serial:/dev/ttyUSB0            a test for every vector that the board takes
    pytest --plumb-golden --plumb-board virtual --plumb-image my.bin   your build of the firmware
    pytest --plumb-board virtual --plumb-gdb 3333 -k name              stop in your test, step and look with gdb
    pytest -m plumb_golden --plumb-golden --plumb-vector 'quad_*'      only these vectors, none of your own tests

The fixture `plumb_board` is a `plumb.Board`, as `plumb.connect` opens it: `run`, `params`, `stream`, `arm`. Without
--plumb-board it is `native`, the C core in this process. Without an option the plugin collects nothing and imports
nothing of plumb.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from plumb.api.connection import Board
    from plumb.proof.golden import Case

DEFAULT_BOARD = "native"


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("plumb", "plumb: golden vectors and boards")
    group.addoption("--plumb-golden", action="store_true", help="collect a test for every golden vector and board")
    group.addoption(
        "--plumb-board",
        action="append",
        metavar="B",
        help=f"board, as of plumb golden check; repeatable ({DEFAULT_BOARD})",
    )
    group.addoption("--plumb-image", type=Path, metavar="FILE", help="flash image of --plumb-board virtual")
    group.addoption("--plumb-link", choices=("serial", "can"), default="serial", help="link to --plumb-board virtual")
    group.addoption(
        "--plumb-gdb",
        type=int,
        metavar="PORT",
        help="serve gdb at this port; board virtual waits for it at first",
    )
    group.addoption("--plumb-vector", action="append", metavar="NAME", help="only this vector; * and ?; repeatable")
    group.addoption("--plumb-vectors", type=Path, metavar="DIR", help="folder of the vectors (default: plumb's own)")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "plumb_golden: a golden vector of plumb on a board (--plumb-golden)")


class Boards:
    """The boards of a session: each is opened when it is used first, and stays open until the session ends."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._open: dict[str, Board] = {}
        self._refused: dict[str, Exception] = {}
        self._debugger = contextlib.ExitStack()
        self._debugged = config.getoption("--plumb-gdb")

    def get(self, name: str) -> Board:
        """Raises UsageError and LinkError; of a board that could not be opened the same error again, at once."""
        from plumb.api.connection import connect

        if name in self._refused:
            raise self._refused[name]
        if name not in self._open:
            link, image = self._config.getoption("--plumb-link"), self._config.getoption("--plumb-image")
            try:
                self._serve_debugger()
                self._open[name] = connect(name, link=link, image=image)
            except Exception as error:
                self._refused[name] = error
                raise
        return self._open[name]

    def _serve_debugger(self) -> None:
        """Serve gdb, if it is to be served and is not yet. Raises LinkError for a port that is taken."""
        if self._debugged is None:
            return
        from plumb.boards.debugging import debugged

        port, self._debugged = self._debugged, None
        self._debugger.enter_context(debugged(port, waits=True, say=self._say))

    def _say(self, text: str) -> None:
        """Print a line at once: somebody has to act on it while the test stands."""
        capture = self._config.pluginmanager.getplugin("capturemanager")
        with contextlib.nullcontext() if capture is None else capture.global_and_fixture_disabled():
            print(f"plumb: {text}", file=sys.stderr, flush=True)

    def drop(self, name: str) -> None:
        """Close a board whose link is out of step or gone; the next use opens it again."""
        from plumb.errors import LinkError

        if name in self._open:
            with contextlib.suppress(LinkError):
                self._open.pop(name).close()

    def close(self) -> None:
        for name in list(self._open):
            self.drop(name)
        self._debugger.close()


_BOARDS = pytest.StashKey[Boards]()


def _boards(config: pytest.Config) -> Boards:
    if _BOARDS not in config.stash:
        config.stash[_BOARDS] = boards = Boards(config)
        config.add_cleanup(boards.close)
    return config.stash[_BOARDS]


def _names(config: pytest.Config) -> list[str]:
    return list(dict.fromkeys(config.getoption("--plumb-board") or [DEFAULT_BOARD]))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "plumb_board" in metafunc.fixturenames:
        metafunc.parametrize("plumb_board", _names(metafunc.config), indirect=True, scope="session")


@pytest.fixture(scope="session")
def plumb_board(request: pytest.FixtureRequest) -> Iterator[Board]:
    """The board of --plumb-board, open, as `plumb.connect` gives it; a test runs once for each of them."""
    yield _boards(request.config).get(request.param)


class Difference(Exception):
    """A vector that a board did not pass; the message says step and signal."""


class GoldenVectors(pytest.Collector):
    """All golden vectors on all boards that were asked for."""

    def collect(self) -> Iterator[GoldenVector]:
        from plumb.errors import PlumbError
        from plumb.link.endpoint_names import parse_board
        from plumb.proof import golden

        option = self.config.getoption
        try:
            kinds = {name: parse_board(name) for name in _names(self.config)}
            folder = golden.vectors_folder(option("--plumb-vectors"))
            cases = golden.cases(folder, patterns=option("--plumb-vector"))
        except PlumbError as error:
            raise pytest.UsageError(str(error)) from None
        for name, kind in kinds.items():
            for case in cases:
                if golden.takes(kind, case):
                    yield GoldenVector.from_parent(
                        self,
                        name=f"{case.entry.name}[{name}]",
                        board=name,
                        case=case,
                        file=folder / (case.entry.name + golden.SUFFIX),
                    )


class GoldenVector(pytest.Item):
    """One golden vector on one board."""

    def __init__(self, *, board: str, case: Case, file: Path, **parent: Any) -> None:
        super().__init__(**parent)
        self.board, self.case, self.file = board, case, file
        self.add_marker(pytest.mark.plumb_golden)

    def runtest(self) -> None:
        from plumb.errors import LinkError
        from plumb.proof import golden

        boards = _boards(self.config)
        try:
            result = golden.check_vector(boards.get(self.board).runs_on, self.board, self.case)
        except LinkError:
            boards.drop(self.board)
            raise
        if result.verdict != "pass":
            raise Difference(result.describe())

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """One sentence; a traceback for a defect alone."""
        from plumb.errors import PlumbError

        if isinstance(excinfo.value, (Difference, PlumbError)):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self.file, None, self.name


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(session: pytest.Session, config: pytest.Config, items: list[pytest.Item]) -> None:
    """Add the vectors before -k and -m choose among all tests."""
    if config.getoption("--plumb-golden"):
        whole = GoldenVectors.from_parent(session, name="plumb-golden", nodeid="plumb-golden")
        items += whole.collect()
