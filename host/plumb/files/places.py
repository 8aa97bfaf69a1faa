"""Folders that the platform has for programs: settings, state that outlives a session, and what ends at log-out.

On Linux these are ~/.config/plumb, ~/.local/state/plumb and /run/user/UID/plumb; XDG_CONFIG_HOME, XDG_STATE_HOME and
XDG_RUNTIME_DIR move them. Nothing is created here.
"""

from __future__ import annotations

from pathlib import Path

APP = "plumb"


def config_folder() -> Path:
    """Folder of the user's settings."""
    from platformdirs import user_config_path

    return user_config_path(APP, appauthor=False)


def state_folder() -> Path:
    """Folder of data that plumb keeps from one session to the next."""
    from platformdirs import user_state_path

    return user_state_path(APP, appauthor=False)


def runtime_folder() -> Path:
    """Folder of data about running processes: which serves a board, and where."""
    import warnings

    from platformdirs import user_runtime_path

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a XDG_RUNTIME_DIR that is not this user's: another folder is taken
        return user_runtime_path(APP, appauthor=False)
