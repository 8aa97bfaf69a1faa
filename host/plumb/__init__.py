"""plumb: attitude estimation and control in integers, the same answer bit for bit from Python to silicon.

    import plumb

    estimate = plumb.Estimator("quad", period_s=0.01, gyr_range_dps=500, acc_range_g=4).run(gyr_radps, acc_mps2)
    result = plumb.run("quad", board="virtual", scenario="hold")
    figures = plumb.runs("quad", runs=1000, scenario="hold").figures
    with plumb.connect("serial:/dev/ttyUSB0") as board:
        board.params["pid.kp"] = 0.05

A name is loaded when it is used first: `import plumb` alone loads no other module.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from plumb import aio as aio
    from plumb.api import golden as golden
    from plumb.api.campaigns import Runs as Runs
    from plumb.api.campaigns import runs as runs
    from plumb.api.connection import Board as Board
    from plumb.api.connection import connect as connect
    from plumb.api.estimator import Estimate as Estimate
    from plumb.api.estimator import Estimator as Estimator
    from plumb.api.live import Gap as Gap
    from plumb.api.live import Health as Health
    from plumb.api.live import Sample as Sample
    from plumb.api.loading import load as load
    from plumb.api.logged import LoggedRun as LoggedRun
    from plumb.api.parameters import ParameterDescription as ParameterDescription
    from plumb.api.parameters import Parameters as Parameters
    from plumb.api.recordings import Recording as Recording
    from plumb.api.runs import RunResult as RunResult
    from plumb.api.runs import run as run
    from plumb.errors import LinkError as LinkError
    from plumb.errors import PlumbError as PlumbError
    from plumb.errors import RecordingWarning as RecordingWarning
    from plumb.errors import UsageError as UsageError

    __version__: str
    """Version of the package, from git's tags: `plumb.version`."""

_PLACES = {
    "Board": "plumb.api.connection",
    "Estimate": "plumb.api.estimator",
    "Estimator": "plumb.api.estimator",
    "Gap": "plumb.api.live",
    "Health": "plumb.api.live",
    "LinkError": "plumb.errors",
    "LoggedRun": "plumb.api.logged",
    "ParameterDescription": "plumb.api.parameters",
    "Parameters": "plumb.api.parameters",
    "PlumbError": "plumb.errors",
    "Recording": "plumb.api.recordings",
    "RecordingWarning": "plumb.errors",
    "RunResult": "plumb.api.runs",
    "Runs": "plumb.api.campaigns",
    "Sample": "plumb.api.live",
    "UsageError": "plumb.errors",
    "aio": "plumb",
    "connect": "plumb.api.connection",
    "golden": "plumb.api",
    "load": "plumb.api.loading",
    "run": "plumb.api.runs",
    "runs": "plumb.api.campaigns",
}
"""Public name -> the module that has it."""

__all__ = [
    "Board", "Estimate", "Estimator", "Gap", "Health", "LinkError", "LoggedRun", "ParameterDescription", "Parameters",
    "PlumbError", "Recording", "RecordingWarning", "RunResult", "Runs", "Sample", "UsageError", "aio", "connect",
    "golden", "load", "run", "runs",
]  # fmt: skip


if not TYPE_CHECKING:  # a type checker would take every name for one that there is

    def __getattr__(name: str) -> object:
        """Load a public name when it is used first (PEP 562)."""
        import importlib

        if name == "__version__":
            from plumb.version import installed

            return installed().version
        if name not in _PLACES:
            raise AttributeError(f"module 'plumb' has no attribute '{name}'")
        if name in ("aio", "golden"):
            return importlib.import_module(f"{_PLACES[name]}.{name}")
        return getattr(importlib.import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
