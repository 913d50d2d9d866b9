# SPDX-License-Identifier: MIT
"""A release received, verified, and installed into its own virtual environment; nothing that runs is touched."""

import dataclasses
import json
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

from segway_ecc.deploy.release.agent.files import AgentRefusedError, is_safe, sha256_of, sync_folder, write_whole
from segway_ecc.deploy.release.agent.journal import Reporter, stamp
from segway_ecc.deploy.release.agent.services import run
from segway_ecc.deploy.release.agent.store import (
    MANIFEST,
    ROBOT_FILE,
    FileDigest,
    ReleaseManifest,
    Store,
    digests_from,
    entries_of,
)

_GROWTH: Final = 4
"""How much larger wheels are once they are installed, together with themselves."""
_SPARE_BYTES: Final = 64 * 2**20
_CHUNK: Final = 2**18
_NICE: Final = ("nice", "-n", "10")
"""The robot's own programs, and the connection that this is asked over, come first."""
_INSTALL_S: Final = 1800.0
_TEST_S: Final = 120.0
_ENVIRONMENT: Final = "environment"
"""In a release's folder; the units read it before /etc/segway-ecc/environment."""
_BOOTSTRAPPER: Final = "ros_wheels_bootstrapper"


@dataclasses.dataclass(frozen=True, slots=True)
class ReleaseSpec:
    """What is pushed.

    Attributes:
        version: What its `--version` has to print.
        by: Who pushes it.
        requirement: What pip is to install: a wheel of the release, perhaps with extras.
        system_site: Whether it sees the system's Python packages, as for the system's ROS.
    """

    name: str
    version: str
    by: str
    requirement: str
    system_site: bool
    files: Mapping[str, FileDigest]


def release_spec_from(request: Mapping[str, Any]) -> ReleaseSpec:
    """The request's release.

    Raises:
        AgentRefusedError: A path leads elsewhere.
    """
    files = digests_from(request["files"])
    for path in (*files, str(request["requirement"]).partition("[")[0]):
        if not is_safe(path):
            raise AgentRefusedError(f"{path!r} is no path within a release")
    fields = {key: str(request[key]) for key in ("name", "version", "by", "requirement")}
    return ReleaseSpec(system_site=bool(request["system_site"]), files=files, **fields)


def check_free_space(store: Store, spec: ReleaseSpec) -> None:
    """Refuse what does not fit.

    Raises:
        AgentRefusedError: The disk has too little free space.
    """
    state = os.statvfs(store.root)
    needed = _GROWTH * sum(digest.size for digest in spec.files.values()) + _SPARE_BYTES
    free = state.f_bavail * state.f_frsize
    if free < needed:
        raise AgentRefusedError(f"{store.root} has {free / 1e6:.0f} MB free and {needed / 1e6:.0f} MB are needed")


def receive(store: Store, spec: ReleaseSpec, stream: BinaryIO, reporter: Reporter) -> None:
    """Take what the robot does not have yet; files that are whole are kept when the connection is cut.

    Raises:
        AgentRefusedError: A file did not arrive as announced.
    """
    folder, incoming = store.folder(spec.name), store.incoming(spec.name)
    # What an interrupted push left of the same release is used again, but for what it had installed.
    if folder.exists() and incoming.exists():
        store.remove(spec.name)
    elif folder.exists():
        (folder / MANIFEST).unlink(missing_ok=True)
        folder.rename(incoming)
    shutil.rmtree(incoming / "venv", ignore_errors=True)
    incoming.mkdir(parents=True, exist_ok=True)
    others = store.complete()  # once: reading a manifest of thousands of files takes a small computer a second
    for path, digest in spec.files.items():
        place = incoming / path
        place.parent.mkdir(parents=True, exist_ok=True)
        if digest.mismatch(place):
            _reuse_file(store, others, path, digest, place)
    missing = [path for path, digest in spec.files.items() if digest.mismatch(incoming / path)]
    reporter.event("need", files=missing)
    for path in missing:
        _receive_file(stream, incoming / path, spec.files[path])
    for place in incoming.rglob("*"):
        if not place.is_dir() and place.relative_to(incoming).as_posix() not in spec.files:
            place.unlink()
    incoming.rename(folder)
    sync_folder(store.releases)


def install(store: Store, spec: ReleaseSpec, reporter: Reporter) -> None:
    """Make the virtual environment, and complete the release: its manifest comes last, once all is on the disk.

    Raises:
        AgentRefusedError: Python or pip cannot do it.
    """
    folder = store.folder(spec.name)
    reporter.step("venv")
    options = ["--system-site-packages"] if spec.system_site else []
    _run([sys.executable, "-I", "-m", "venv", "--without-pip", *options, str(folder / "venv")], _INSTALL_S)
    reporter.step("install")
    pip = next((path for path in spec.files if path.startswith("wheels/pip-")), None)
    if pip is None:
        raise AgentRefusedError("the push brings no pip")
    python, wheels = str(folder / "venv" / "bin" / "python"), str(folder / "wheels")
    what = str(folder / spec.requirement)
    quiet = ["--no-index", "--no-cache-dir", "--disable-pip-version-check", "--quiet", "--root-user-action=ignore"]
    _run([python, "-I", str(folder / pip / "pip"), "install", *quiet, "--find-links", wheels, what], _INSTALL_S)
    reporter.step("complete")
    write_environment(folder)
    manifest = ReleaseManifest(spec.name, spec.version, stamp(), spec.by, entries_of(folder))
    os.sync()
    manifest.write(folder)


def self_test(store: Store, manifest: ReleaseManifest, config: Path, reporter: Reporter) -> None:
    """Have the release print its version and load the robot file, before anything is switched.

    Raises:
        AgentRefusedError: It does not.
    """
    reporter.step("selftest")
    folder = store.folder(manifest.name)
    own = folder / ROBOT_FILE
    robot = own if own.exists() else config / "robot.yaml"
    command = str(folder / "venv" / "bin" / "segway-ecc")
    version = _run([command, "--version"], _TEST_S).strip()
    if version != manifest.version:
        raise AgentRefusedError(f"{command} --version prints {version!r}, not {manifest.version!r}")
    found = _run([command, "deploy", "check", "--json", str(robot)], _TEST_S)
    try:
        rate_hz = float(json.loads(found)["rate_hz"])
    except (ValueError, KeyError, TypeError):
        raise AgentRefusedError(f"{command} deploy check does not print the robot's rate") from None
    tested = dataclasses.replace(manifest, rate_hz=rate_hz)
    if tested != manifest:
        tested.write(folder)


def _reuse_file(store: Store, others: Sequence[ReleaseManifest], path: str, digest: FileDigest, place: Path) -> None:
    for manifest in others:
        theirs = store.folder(manifest.name) / path
        if manifest.files.get(path) == digest and not digest.mismatch(theirs):
            place.unlink(missing_ok=True)
            if path.startswith("wheels/"):
                place.hardlink_to(theirs)
            else:  # a robot file may be edited in place, which must not change another release
                shutil.copyfile(theirs, place)
            return


def _receive_file(stream: BinaryIO, place: Path, digest: FileDigest) -> None:
    part = place.with_name(f".{place.name}.part")
    left = digest.size
    with part.open("wb") as file:
        while left and (piece := stream.read(min(left, _CHUNK))):
            file.write(piece)
            left -= len(piece)
    if left or sha256_of(part) != digest.sha256:
        part.unlink()
        raise AgentRefusedError(f"{place.name} did not arrive whole; push again")
    part.replace(place)


def _run(words: Sequence[str], within_s: float) -> str:
    done = run([*_NICE, *words], within_s, "/")
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-3:]
        raise AgentRefusedError(f"{' '.join(words[:5])} ... ended with {done.returncode}: {' / '.join(last)}")
    return done.stdout


def write_environment(folder: Path, place: Path | None = None) -> None:
    """Write the variables of a release that is installed; no file where it needs none.

    ROS 2 from PyPI needs its libraries in LD_LIBRARY_PATH. Where that is not set its start hook looks for them and
    starts Python a second time, each time; with the variables here that is saved.

    Args:
        folder: The release's, with its virtual environment.
        place: Where that folder will be; None where it is there already.
    """
    found = sorted(folder.glob(f"venv/lib/python3*/site-packages/{_BOOTSTRAPPER}"))
    (folder / _ENVIRONMENT).unlink(missing_ok=True)
    if not found:
        return
    libraries = [folder / "venv" / "lib", *sorted(found[0].parent.glob("ros_*.libs"))]
    there = [str((place or folder) / path.relative_to(folder)) for path in libraries]
    text = f"_ROS_WHEELS_BOOTSTRAP_COMPLETE=1\nLD_LIBRARY_PATH={':'.join(there)}\n"
    write_whole(folder / _ENVIRONMENT, text.encode())
