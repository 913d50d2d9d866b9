# SPDX-License-Identifier: MIT
"""FMUs in the runtime: FMI 2.0 and 3.0 for co-simulation, from 20-sim and from any other tool."""

import ctypes
import dataclasses
import math
import os
import shutil
import stat
import tempfile
import weakref
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.native.compile import cached, digest, exported, repeatability_warnings
from segway_ecc.node.native.fmu.binary import find_library, private_copy, shim
from segway_ecc.node.native.fmu.description import FmuLayout, describe
from segway_ecc.node.native.fmu.facts import Facts, read_facts
from segway_ecc.node.native.fmu.twenty_sim import SECTIONS, TwentySim, read_twenty_sim
from segway_ecc.node.native.library import Kind, NativeModel

LARGEST_BYTES: Final = 2 * 1024**3
"""An FMU that unpacks to more than this is taken for a mistake."""
_BROKEN: Final = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError, OSError)
"""What zipfile raises on damaged, truncated, encrypted or unknown content."""
_FOREVER: Final = 1e300
"""End of the experiment given to 20-sim's FMUs, s: older ones stop at a baked-in end when they are given none."""


def unpack(path: Path) -> Path:
    """Return the folder that holds an FMU's content, the same for the same bytes; unpacks it where it is new.

    Raises:
        ModelError: It cannot be read, is no zip file, is damaged, or has an entry that leaves the folder.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(f"cannot read the FMU {path}: {error.strerror or error}") from error

    def extract(draft: Path) -> None:
        try:
            with zipfile.ZipFile(path) as archive:
                _extract(archive, path, draft)
        except _BROKEN as error:
            raise ModelError(f"FMU {path} is broken: {error}; export or copy it again") from error

    return cached(digest("fmu", content), extract)


def _extract(archive: zipfile.ZipFile, path: Path, folder: Path) -> None:
    # Some tools on Windows write its separators into the zip file.
    targets = [(entry, PurePosixPath(entry.filename.replace("\\", "/"))) for entry in archive.infolist()]
    for entry, name in targets:
        if name.is_absolute() or ".." in name.parts or stat.S_ISLNK(entry.external_attr >> 16):
            raise ModelError(f"FMU {path} is refused: its entry '{entry.filename}' leads out of the FMU's own folder")
    total = sum(entry.file_size for entry, _ in targets)
    if total > LARGEST_BYTES:
        raise ModelError(f"FMU {path} is refused: it unpacks to {total} bytes; at most {LARGEST_BYTES} are taken")
    for entry, name in targets:
        is_folder = entry.filename.endswith(("/", "\\"))
        (folder / name if is_folder else (folder / name).parent).mkdir(parents=True, exist_ok=True)
        if not is_folder:
            with archive.open(entry) as source, (folder / name).open("wb") as sink:
                shutil.copyfileobj(source, sink)


class _Group(ctypes.Structure):
    """`Group` of calls.h."""

    _fields_ = (
        ("count", ctypes.c_int32),
        ("references", ctypes.POINTER(ctypes.c_uint32)),
        ("starts", ctypes.POINTER(ctypes.c_double)),
        ("written", ctypes.POINTER(ctypes.c_uint8)),
        ("live", ctypes.POINTER(ctypes.c_uint8)),
    )


class _FmuPlan(ctypes.Structure):
    """`Plan` of calls.h."""

    _fields_ = (
        ("library", ctypes.c_char_p),
        ("prefix", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("token", ctypes.c_char_p),
        ("resources", ctypes.c_char_p),
        ("restart_symbols", ctypes.c_char_p * len(SECTIONS)),
        ("starting_symbol", ctypes.c_char_p),
        ("static_symbol", ctypes.c_char_p),
        ("stop_symbol", ctypes.c_char_p),
        ("step", ctypes.c_double),
        ("stop", ctypes.c_double),
        ("version", ctypes.c_int32),
        ("keeps_state", ctypes.c_int32),
        ("groups", _Group * len(Kind)),
        ("followers", ctypes.POINTER(ctypes.c_int32)),
    )


class FmuModel(NativeModel):
    """An FMU.

    Each instance loads a copy of the FMU's library of its own, so two of them share nothing, even where the FMU keeps
    its values in globals. Every `initialize` loads it anew. A parameter keeps what was written to it when the model is
    initialized again; a state starts anew unless it is one that takes effect then.
    """

    def __init__(
        self, layout: FmuLayout, library: Path, facts: Facts, twenty_sim: TwentySim | None, resources: Path
    ) -> None:
        """Load a private copy of an FMU's library into a folder of its own.

        Raises:
            ModelError: The library cannot be loaded, or lacks a function.
        """
        warnings = (*layout.description.warnings, *repeatability_warnings(library, exported(shim())))
        super().__init__(dataclasses.replace(layout.description, warnings=warnings), shim())
        place, plan = Path(tempfile.mkdtemp(prefix="segway-ecc-fmu-")), _plan(layout, facts, twenty_sim)
        # Also at the end of the process, and before the copy's folder goes; the library uses the plan until then.
        weakref.finalize(self, _release, self._library, place, plan, os.getpid())
        plan.library = str(private_copy(library, resources, place)).encode()
        # A URI in FMI 2.0 (section 2.1.5), a path with a separator at its end in FMI 3.0 (section 2.3.1).
        if facts.version == 2:  # noqa: PLR2004 - the standard's number
            plan.resources = resources.as_uri().encode()
        elif resources.is_dir():
            plan.resources = f"{resources}/".encode()
        self._library.ecc_fmu_open.argtypes = (ctypes.POINTER(_FmuPlan),)
        self._plan = plan
        self._check(self._library.ecc_fmu_open(ctypes.byref(plan)), "load")

    def keep_in_process(self) -> Callable[[], None]:
        """Keep what it is now, in this process alone; what it returns puts that back. A ModelError where it cannot."""
        place, stopped = self._library.ecc_keep(), self.stopped
        self._check(place, "give its state")
        groups = [self._plan.groups[kind] for kind in (Kind.PARAMETER, Kind.STATE)]
        sizes = [(group.starts, 8 * group.count) for group in groups] + [(g.written, g.count) for g in groups]
        held = [(memory, ctypes.string_at(memory, size)) for memory, size in sizes]

        def put_back() -> None:
            for memory, content in held:
                ctypes.memmove(memory, content, len(content))
            self._check(self._library.ecc_put_back(place), "take its state back")
            self.stopped = stopped

        return put_back


def _release(library: ctypes.CDLL, place: Path, _plan: _FmuPlan, process: int) -> None:
    if os.getpid() == process:  # a fork that ends leaves its parent's files alone
        library.ecc_fmu_close()
        shutil.rmtree(place, ignore_errors=True)


def load_fmu(path: Path, step_size: float | None = None) -> FmuModel:
    """Load an FMU with a step of `step_size`, s, or None for the one that the FMU asks for.

    It is unpacked into the cache once; the file itself is only read. Loading what is unpacked takes milliseconds, and
    compiling, where the FMU has no library for this machine, seconds.

    Raises:
        ModelError: It cannot run here; the text gives the reason and what to do.
    """
    folder = unpack(path)
    facts = read_facts(folder, path)
    library = find_library(folder, facts.identifier, path)
    twenty_sim = read_twenty_sim(folder, facts.tool, exported(library))
    layout = describe(facts, twenty_sim, step_size, path)
    try:
        return FmuModel(layout, library, facts, twenty_sim, folder / "resources")
    except ModelError as error:
        raise ModelError(f"FMU {path}: {error}") from error


def _plan(layout: FmuLayout, facts: Facts, twenty_sim: TwentySim | None) -> _FmuPlan:
    plan = _FmuPlan(
        prefix=f"{facts.identifier}_".encode(),
        name=(facts.name or facts.identifier).encode(),
        token=facts.token.encode(),
        step=layout.description.step_size,
        stop=math.inf if twenty_sim is None else _FOREVER,
        version=facts.version,
        keeps_state=facts.keeps_state,
        followers=(ctypes.c_int32 * len(layout.followers))(*layout.followers),
    )
    if twenty_sim is not None:
        for name in ("starting_symbol", "static_symbol", "stop_symbol"):
            if (symbol := getattr(twenty_sim, name)) is not None:
                setattr(plan, name, symbol.encode())
        for place, symbol in enumerate(twenty_sim.restart_symbols):
            plan.restart_symbols[place] = symbol.encode()
    for kind, references in enumerate(layout.references):
        plan.groups[kind] = _group(references, layout.description.by_kind[kind])
    return plan


def _group(references: Sequence[int], variables: Sequence[Variable]) -> _Group:
    count = len(references)
    live = [variable.write in (Write.NOW, Write.STATIC) for variable in variables]
    return _Group(
        count=count,
        references=(ctypes.c_uint32 * count)(*references),
        starts=(ctypes.c_double * count)(*(variable.value for variable in variables)),
        written=(ctypes.c_uint8 * count)(),
        live=(ctypes.c_uint8 * count)(*live),
    )
