# SPDX-License-Identifier: MIT
"""What distributions bring by entry point: ours and others are found in the same way, and imported when used."""

import functools
import importlib
from collections.abc import Iterable, Sequence
from typing import Final, Protocol, TypeVar

from segway_ecc.firmware_io.errors import PluginError

DRIVES: Final = "segway_ecc.drives"
"""The group of drive families: each entry point is the family's name in robot files, and names a `DriveFamily`."""
IMUS: Final = "segway_ecc.imus"
"""The group of IMUs: each entry point is the IMU's name in robot files, and names an `ImuFamily`."""

Record = TypeVar("Record")

_VOWELS: Final = tuple("AEIOU")
_LONGEST_NAME: Final = 80
"""Of what a file asks for, as a message shows it."""


class EntryPoint(Protocol):
    """What is registered under a name, and imported by `load`; `value` is `module:name`."""

    @property
    def name(self) -> str:
        """Under which it is found."""

    @property
    def value(self) -> str:
        """Where it is."""

    def load(self) -> object:
        """Import it."""


class _EntryPoints(Protocol):
    def select(self, *, group: str) -> Iterable[EntryPoint]: ...


@functools.cache
def all_entry_points() -> _EntryPoints:
    """All that are installed: to look for them takes longer than the rest of reading a robot file, so once."""
    # Here and not at the head of the file, since a robot starts without some of what it imports.
    found: _EntryPoints = importlib.import_module("importlib.metadata").entry_points()
    return found


def entry_points(group: str) -> Sequence[EntryPoint]:
    """The entry points of a group, in the order in which their distributions are found."""
    return tuple(all_entry_points().select(group=group))


def load_plugin(group: str, name: object, what: str, kind: type[Record]) -> Record:
    """Import the record that is registered under a name.

    Nothing else is imported, so that one that is broken ends no other.

    Args:
        group: The group of entry points.
        name: Its name, as found in a file.
        what: What that is, for messages: `drive family`.
        kind: The record's class. Where it has `settings`, their tag must be the name.

    Raises:
        PluginError: None of that name is installed, or several are, or it cannot be imported, or is another record.
    """
    points = [point for point in entry_points(group) if point.name == name]
    if not points:
        installed = ", ".join(sorted({point.name for point in entry_points(group)})) or "none"
        raise PluginError(f"there is no {what} {repr(name)[:_LONGEST_NAME]}; installed are {installed}")
    if len({point.value for point in points}) > 1:
        places = " and ".join(sorted(point.value for point in points))
        raise PluginError(f"{what} '{name}' is installed twice, as {places}; uninstall one of them")
    found = import_plugin(points[0], what)
    settings = getattr(found, "settings", None)
    if isinstance(found, kind) and (settings is None or settings.__struct_config__.tag == name):
        return found
    article = "an" if kind.__name__.startswith(_VOWELS) else "a"
    tagged = ", with that tag on its settings" if "settings" in getattr(kind, "__dataclass_fields__", {}) else ""
    raise PluginError(f"{what} '{name}' is none: its entry point must name {article} {kind.__name__}{tagged}")


def import_plugin(point: EntryPoint, what: str) -> object:
    """Import what an entry point names.

    Raises:
        PluginError: That fails, in whatever way.
    """
    try:
        return point.load()
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise PluginError(f"{what} '{point.name}' ({point.value}) cannot be imported: {reason}") from error
