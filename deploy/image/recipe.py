# SPDX-License-Identifier: MIT
"""What an image consists of: the recipe, its Debian packages, made once and kept, the manifest, and who makes it.

The manifest is what an image was made of, so that it can be made again, and what differs between two can be listed.
"""

import dataclasses
import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from segway_ecc.node import folders
from segway_ecc.node.errors import NodeError

PROGRAMS: Final = {
    "mmdebstrap": "mmdebstrap",
    "mke2fs": "e2fsprogs",
    "unshare": "util-linux",
    "chroot": "coreutils",
    "tar": "tar",
}
_PATH: Final = "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_LINES: Final = 8
KERNELS: Final = {"none": (), "rt": ("linux-image-rt-amd64",), "cloud": ("linux-image-cloud-amd64",)}
"""Kernels by what they are for: of the image's own none, a robot's, and a virtual machine's (which has no CAN)."""
_PACKAGES: Final = (
    "ca-certificates",
    "dbus",
    "e2fsprogs",
    "iproute2",
    "kmod",
    "openssh-server",
    "python3",
    "python3-venv",
    "systemd",
    "systemd-resolved",
    "systemd-sysv",
    "udev",
)
_LEFT_OUT: Final = ("/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/usr/share/info/*")
MANIFEST: Final = "manifest.json"


class ImageError(NodeError):
    """The image cannot be built."""


def missing() -> str | None:
    """What this machine lacks to build images, with the command that installs it; None where it lacks nothing."""
    lacking = sorted({package for program, package in PROGRAMS.items() if shutil.which(program, path=_PATH) is None})
    return f"not installed: sudo apt-get install {' '.join(lacking)}" if lacking else None


def run(words: Sequence[str], *, env: Mapping[str, str] | None = None, cwd: Path | None = None) -> str:
    """Run a program to its end; returns its standard output.

    Raises:
        ImageError: It failed; with its last lines.
    """
    variables = {"PATH": _PATH, "HOME": os.environ.get("HOME", "/"), "LC_ALL": "C.UTF-8", **(env or {})}
    done = subprocess.run(  # noqa: S603 - the words are ours, and no shell reads them
        list(words), env=variables, cwd=cwd, capture_output=True, text=True, errors="replace", check=False
    )
    if done.returncode:
        last = " | ".join((done.stderr or done.stdout).strip().splitlines()[-_LINES:])
        raise ImageError(f"{words[0]} failed with status {done.returncode}: {last}")
    return done.stdout


def inside(root: Path, words: Sequence[str], env: Mapping[str, str] | None = None) -> str:
    """Run a program of the image in the image."""
    return run(["chroot", str(root), *words], env=env)


@dataclass(frozen=True, slots=True)
class Recipe:
    """What is asked for.

    Attributes:
        suite: The Debian release.
        mirror: Where its packages come from.
        packages: Their names, each with =VERSION where it has to be that one.
        extras: Extras of our wheel.
        kernel: One of `KERNELS`.
        vcan: Whether a virtual CAN bus is there from the start, for tests and simulation.
        epoch: The time stamp of everything, seconds since the Unix epoch (SOURCE_DATE_EPOCH).
    """

    suite: str = "bookworm"
    mirror: str = "http://deb.debian.org/debian"
    packages: tuple[str, ...] = _PACKAGES
    extras: tuple[str, ...] = ("ros",)
    kernel: str = "rt"
    vcan: bool = False
    epoch: int = 1_735_689_600

    @property
    def all_packages(self) -> tuple[str, ...]:
        """The packages with those of the kernel."""
        pinned = {name.partition("=")[0] for name in self.packages}
        return (*self.packages, *(name for name in KERNELS[self.kernel] if name not in pinned))

    @property
    def base_digest(self) -> str:
        """Names what the packages depend on: an image with the same has the same packages."""
        parts = [self.suite, self.mirror, self.all_packages, self.epoch]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def image_cache() -> Path:
    """Where what takes long is kept (XDG base directories)."""
    folder = folders.cache_folder() / "image"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def base_archive(recipe: Recipe) -> Path:
    """The archive of a root file system with the recipe's packages; takes minutes the first time.

    Without root mmdebstrap makes it in a user namespace of its own.

    Raises:
        ImageError: A package is not to be had, or mmdebstrap does not work here.
    """
    archive = image_cache() / f"base-{recipe.suite}-{recipe.base_digest}.tar"
    if archive.exists():
        return archive
    part = archive.with_name(f".{os.getpid()}-{archive.name}")
    words = ["mmdebstrap", "--variant=minbase", f"--include={','.join(recipe.all_packages)}"]
    words += [f"--dpkgopt=path-exclude={path}" for path in _LEFT_OUT]
    words += ['--aptopt=Acquire::Languages "none"', "--aptopt=Acquire::Check-Valid-Until false"]
    try:
        run([*words, recipe.suite, str(part), recipe.mirror], env={"SOURCE_DATE_EPOCH": str(recipe.epoch)})
        part.replace(archive)
    finally:
        part.unlink(missing_ok=True)
    return archive


def installed_packages(root: Path) -> dict[str, str]:
    """The version of each Debian package in a root file system."""
    place = "/usr/share/segway-ecc/var/lib/dpkg"  # where `tree.finish` has put /var
    lines = inside(root, ["dpkg-query", f"--admindir={place}", "-W", "-f", "${Package} ${Version}\n"]).split("\n")
    return dict(line.split(" ", 1) for line in lines if line)


def files_of(root: Path) -> dict[str, str]:
    """What each path is: type, mode, owner, and the hash of its content or where it leads."""
    found = {}
    for path in sorted(Path(folder, name) for folder, below, files in os.walk(root) for name in (*below, *files)):
        status = path.lstat()
        text = f"{status.st_mode:o} {status.st_uid}:{status.st_gid} {int(status.st_mtime)}"
        if path.is_symlink():
            text += f" -> {path.readlink()}"
        elif path.is_file():
            text += f" {hashlib.sha256(path.read_bytes()).hexdigest()}"
        found[path.relative_to(root).as_posix()] = text
    return found


def write_manifest(
    path: Path, recipe: Recipe, packages: Mapping[str, str], wheels: Mapping[str, str], root: Path
) -> None:
    """Write the manifest of an image."""
    files = files_of(root)
    digest = hashlib.sha256(json.dumps(files, sort_keys=True).encode()).hexdigest()
    content = {
        "recipe": dataclasses.asdict(recipe),
        "packages": dict(packages),
        "wheels": dict(wheels),
        "digest": digest,
        "files": files,
    }
    path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", "utf-8")


def read_manifest(path: Path) -> dict[str, Any]:
    """Read a manifest.

    Raises:
        ImageError: It is none.
    """
    try:
        content = json.loads(path.read_text("utf-8"))
        recipe_of(content)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        raise ImageError(f"{path} is no manifest of an image") from None
    return dict(content)


def recipe_of(manifest: Mapping[str, Any]) -> Recipe:
    """The recipe that makes the image again: each package of the version that it has."""
    values = dict(manifest["recipe"])
    values["packages"] = tuple(f"{name}={version}" for name, version in sorted(manifest["packages"].items()))
    values["extras"] = tuple(values["extras"])
    return Recipe(**values)


def differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """What differs between two manifests: packages, wheels and files."""
    return [
        f"{kind[:-1]} {name}: {one[kind].get(name, 'missing')} / {other[kind].get(name, 'missing')}"
        for kind in ("packages", "wheels", "files")
        for name in sorted({*one[kind], *other[kind]})
        if one[kind].get(name) != other[kind].get(name)
    ]
