# SPDX-License-Identifier: MIT
"""Where a run comes from: the robot, the model by its content, and the wire's description."""

import hashlib
import sys
from pathlib import Path
from types import ModuleType

import msgspec

from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.node.config import NoHardwareSection, RobotFile
from segway_ecc.node.models.load import PythonSource
from segway_ecc.node.recording.layout import MODEL, ROBOT_FILE, ROBOT_TEXT, Provenance


def provenance_of(file: RobotFile, text: str | None = None) -> Provenance:
    """Where a run of a robot comes from, by its file in force, and as it was written where there is such a text.

    The software and the machine are added by the log.
    """
    attachments = {ROBOT_FILE: msgspec.json.format(msgspec.json.encode(file)).decode()}
    if text is not None:
        attachments[ROBOT_TEXT] = text
    wire = None if isinstance(file.hardware, NoHardwareSection) else family_of(file.hardware).wire_description
    if wire is not None:
        attachments[wire.name] = wire.read_text(encoding="utf-8")
    source = file.model.source
    return Provenance(attachments, {MODEL: {"source": source, "sha256": model_hash(source)}})


def model_hash(source: str) -> str:
    """The SHA-256 of what a model is made of, hexadecimal.

    That is every file of a folder of generated code, an FMU, or, of a model in Python that is loaded, the source of its
    module and of all that it imports from its own package or folder.
    """
    path = Path(source)
    if path.is_file():
        files = {path.suffix.lower(): path}
    elif path.exists():
        files = {file.relative_to(path).as_posix(): file for file in path.rglob("*") if file.is_file()}
    else:
        python = PythonSource.parse(source)
        files = _python_files(source if python is None else python.module)
    digest = hashlib.sha256()
    for name, file in sorted(files.items()):
        content = file.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def _python_files(first: str) -> dict[str, Path]:
    """Modules that `first` imports, and those that these import, of its package or in its folder; by name."""
    found, to_see = dict[str, Path](), [first]
    while to_see:
        name = to_see.pop()
        path = getattr(sys.modules.get(name), "__file__", None)
        if name in found or path is None or not Path(path).is_file():
            continue
        folder = Path(str(sys.modules[first].__file__)).parent
        if name.partition(".")[0] == first.partition(".")[0] or Path(path).is_relative_to(folder):
            found[name] = Path(path)
            # The modules behind the names of the module.
            values = vars(sys.modules[name]).values()
            behind = (v.__name__ if isinstance(v, ModuleType) else getattr(v, "__module__", None) for v in values)
            to_see += [each for each in behind if isinstance(each, str)]
    return found
