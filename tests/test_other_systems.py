"""macOS and Windows by construction: every module imports, every command explains itself, and a board runs and is
served in a Python that lacks what those systems lack. Nobody has seen plumb there: nothing known is in its way."""

from __future__ import annotations

import subprocess
import sys

import pytest

LACKS = {
    "win32": {
        "modules": "termios tty pty fcntl grp pwd resource readline curses syslog spwd crypt nis ossaudiodev",
        "os": "getuid geteuid getgid getgroups getgrouplist fork forkpty killpg setsid getpgrp tcgetpgrp ttyname "
        "openpty mkfifo chown fchmod pread pwrite sched_getaffinity sched_setaffinity wait3 wait4",
        "signal": "SIGALRM SIGHUP SIGKILL SIGQUIT SIGUSR1 SIGUSR2 SIGCHLD SIGPIPE SIGWINCH SIGTSTP setitimer alarm",
        "select": "poll epoll POLLIN POLLHUP POLLERR EPOLLIN",
        "socket": "AF_UNIX",
    },
    "darwin": {
        "modules": "spwd nis ossaudiodev",
        "os": "sched_getaffinity sched_setaffinity memfd_create O_TMPFILE",
        "signal": "SIGPWR sigwaitinfo sigtimedwait",
        "select": "epoll EPOLLIN",
        "socket": "AF_CAN AF_PACKET AF_NETLINK",
    },
}
"""System -> what Python has on Linux and not there: modules, and names of modules."""

BEGIN = """
import sys
platform, lacks = {platform!r}, {lacks!r}
# What libraries and Python itself read of the platform while they are imported comes before the change.
import asyncio, builtins, concurrent.futures, ctypes, io, logging.handlers, multiprocessing.pool, os, pathlib, select
import selectors, shutil, signal, socket, subprocess, tempfile, threading, urllib.request, uuid, webbrowser, zipfile
import can, can.interfaces.virtual, cantools, filelock, numpy, platformdirs, serial, serial.tools.list_ports, shtab
import tqdm, aiohttp, asammdf, pyarrow, rich.console, scipy.optimize, scipy.stats, unicorn, vcd
# platformdirs has chosen its part for Linux by now, which asks who the user is.
user = os.getuid()
if hasattr(platformdirs, "_paths"):
    platformdirs._paths._effective_uid = lambda: user
for module in lacks["modules"].split():
    sys.modules[module] = None
for place in (os, signal, select, socket):
    for name in lacks[place.__name__].split():
        vars(place).pop(name, None)
sys.platform = platform
opened, chosen = io.open, select.select

def guarded(file, *arguments, **named):
    if isinstance(file, (str, os.PathLike)) and os.fspath(file).startswith(("/proc/", "/sys/", "/dev/tty")):
        raise FileNotFoundError(2, "not on this system", os.fspath(file))
    return opened(file, *arguments, **named)

def windows_select(readable, writable, failed, timeout=None):
    if not (readable or writable or failed):
        raise OSError(10022, "an invalid argument was supplied")
    return chosen(readable, writable, failed, timeout)

builtins.open = io.open = guarded
if platform == "win32":
    select.select = windows_select
"""

IMPORTS = """
import importlib, pkgutil, plumb
for module in pkgutil.walk_packages(plumb.__path__, "plumb."):
    if module.name != "plumb.__main__" and not module.name.startswith("plumb.lib"):  # the C core is no module
        importlib.import_module(module.name)
print(len([name for name in sys.modules if name.startswith("plumb.")]))
"""

COMMANDS = """
import contextlib
from plumb.__main__ import main
from plumb.cli.verbs import commands
for verb in ("", *commands()):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        try:
            main([verb, "--help"] if verb else ["--help"])
        except SystemExit as end:
            assert not end.code, (verb, end.code)
    assert "plumb" in said.getvalue(), verb
for line in (
    ["run", "quad", "--board", "native", "--seconds", "1"],
    ["golden", "check", "--board", "native", "--system", "quad", "--vector", "quad_quiet_tuned"],
    ["monitor", "--board", "virtual", "--run", "live", "--seconds", "1"],
    ["ports"],
    ["systems"],
    ["run", "quad", "--board", "serial:COM3"],
    *([["virtual-board", "--port", "native", "--serial", "pty"]] if platform == "win32" else []),
):
    print(main(line), *line, file=sys.stderr)
"""

SERVED = """
import threading
from plumb.boards.native.served import open_native
from plumb.boards.serve import serve
from plumb.link.session import Session
names, over = [], threading.Event()
said = threading.Event()
def announce(name):
    names.append(name)
    said.set()
served = threading.Thread(target=lambda: serve(open_native(0), "tcp:0", over.is_set, announce=announce))
served.start()
said.wait()
try:
    with Session.open(names[0]) as session:
        print("served:", session.connect().mismatch)
finally:
    over.set()
    served.join()
"""


@pytest.fixture(scope="module", params=LACKS)
def asked(request: pytest.FixtureRequest) -> tuple[str, subprocess.CompletedProcess[str]]:
    """What one Python said that ran the commands, served a board and imported every module, in this order."""
    platform: str = request.param
    program = BEGIN.format(platform=platform, lacks=LACKS[platform]) + COMMANDS + SERVED + IMPORTS
    return platform, subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)


def test_every_module_imports(asked: tuple[str, subprocess.CompletedProcess[str]]) -> None:
    _, done = asked
    assert done.returncode == 0 and int(done.stdout.split()[-1]) > 300, done.stderr


def test_every_command_explains_itself_and_boards_run(asked: tuple[str, subprocess.CompletedProcess[str]]) -> None:
    platform, done = asked
    codes = [line.split(maxsplit=1) for line in done.stderr.splitlines() if line[0].isdigit()]
    assert {line.split()[0]: int(code) for code, line in codes if "serial" not in line} == {
        "run": 0, "golden": 0, "monitor": 0, "ports": 0, "systems": 0
    }, done.stderr  # fmt: skip
    assert ["3", "run quad --board serial:COM3"] in codes and "there is no port COM3" in done.stderr
    if platform == "win32":
        assert ["2", "virtual-board --port native --serial pty"] in codes
        assert "this system has no pseudo-terminals; serve on tcp:PORT" in done.stderr


def test_a_board_is_served_over_tcp(asked: tuple[str, subprocess.CompletedProcess[str]]) -> None:
    _, done = asked
    assert done.stdout.splitlines()[-2:-1] == ["served: None"], done.stderr
