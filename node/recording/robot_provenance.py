"""Where a run comes from: the robot, the model by its content, and the wire's description."""

import hashlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Final

import msgspec

from segway_ecc.firmware_io.drives import wheel_board
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.node.config import RobotFile
from segway_ecc.node.models.locate import PythonSource
from segway_ecc.node.recording.provenance import MODEL, ROBOT_FILE, ROBOT_TEXT, Provenance, with_surroundings

_DBC_FILE: Final = "wheel_board.dbc"


def provenance_of(file: RobotFile, text: str | None = None) -> Provenance:
    """Where a run of a robot comes from; see `robot_provenance` for the arguments."""
    return with_surroundings(robot_provenance(file, text))


def robot_provenance(file: RobotFile, text: str | None = None) -> Provenance:
    """Where a run of a robot comes from, but for the software and the machine; see `with_surroundings`.

    Args:
        file: The robot file as it is in force.
        text: The file as it was written, where there is one.
    """
    attachments = {ROBOT_FILE: msgspec.json.format(msgspec.json.encode(file)).decode()}
    if text is not None:
        attachments[ROBOT_TEXT] = text
    if isinstance(file.hardware, WheelBoardSettings):
        folder = Path(str(wheel_board.__file__)).parent
        attachments[_DBC_FILE] = (folder / _DBC_FILE).read_text(encoding="utf-8")
    source = file.model.source
    return Provenance(attachments, {MODEL: {"source": source, "sha256": model_hash(source)}})


def model_hash(source: str) -> str:
    """The SHA-256 of what a model is made of, hexadecimal.

    That is every file of a folder of generated code, an FMU, or, of a model in Python that is loaded, the source of its
    module and of all that it imports from its own package or folder.
    """
    digest = hashlib.sha256()
    for name, path in sorted(_native_files(Path(source)) if Path(source).exists() else _python_files(source)):
        content = path.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def _native_files(path: Path) -> Iterator[tuple[str, Path]]:
    if path.is_file():
        yield path.suffix.lower(), path
        return
    for file in path.rglob("*"):
        if file.is_file():
            yield file.relative_to(path).as_posix(), file


def _python_files(source: str) -> Iterator[tuple[str, Path]]:
    python = PythonSource.parse(source)
    first = source if python is None else python.module
    seen, to_see = set(), [first]
    while to_see:
        name = to_see.pop()
        module = sys.modules.get(name)
        if name in seen or module is None or not _is_of(first, module):
            continue
        seen.add(name)
        yield name, Path(str(module.__file__))
        to_see += _imported(module)


def _imported(module: ModuleType) -> Iterator[str]:
    """The modules behind the names of a module."""
    for value in vars(module).values():
        name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        if isinstance(name, str):
            yield name


def _is_of(first: str, module: ModuleType) -> bool:
    """Whether a module is of the same package as the model's, or lies in its folder."""
    path = getattr(module, "__file__", None)
    if path is None or not Path(path).is_file():
        return False
    package = first.partition(".")[0]
    folder = Path(str(sys.modules[first].__file__)).parent
    return module.__name__.partition(".")[0] == package or Path(path).is_relative_to(folder)
