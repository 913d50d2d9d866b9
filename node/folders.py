# SPDX-License-Identifier: MIT
"""Where a user's files go: the XDG base directories, each with a folder of ours in it."""

import os
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ConfigurationError

_OURS: Final = "segway-ecc"


def cache_folder() -> Path:
    """What can be made anew; it may not be there yet.

    Raises:
        ConfigurationError: The user has no home folder.
    """
    return _folder("XDG_CACHE_HOME", ".cache")


def state_folder() -> Path:
    """What runs leave, as logs; see `cache_folder`."""
    return _folder("XDG_STATE_HOME", ".local/state")


def _folder(variable: str, below_home: str) -> Path:
    given = Path(os.environ.get(variable, ""))
    if given.is_absolute():  # others are to be ignored, by the specification
        return given / _OURS
    try:
        return Path.home() / below_home / _OURS
    except RuntimeError as error:  # as in a container, of a user whom it does not know
        raise ConfigurationError(f"this user has no home folder: set HOME, or {variable}") from error
