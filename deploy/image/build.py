# SPDX-License-Identifier: MIT
"""From a recipe to an image: a folder with our release in it, a manifest, file systems, and a disk.

Our release is wheels, installed in a virtual environment of its own.
"""

import dataclasses
import datetime as dt
import hashlib
import os
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image import disk, tree
from segway_ecc.deploy.image.recipe import (
    MANIFEST,
    ImageError,
    Recipe,
    base_archive,
    image_cache,
    inside,
    installed_packages,
    missing,
    run,
    write_manifest,
)
from segway_ecc.deploy.release.agent.files import sha256_of
from segway_ecc.deploy.release.agent.install import write_environment
from segway_ecc.deploy.release.agent.store import HEALTHY, ReleaseManifest, entries_of
from segway_ecc.deploy.release.wheels import CHECKOUT, WHEEL, extras_text

OPT: Final = "opt/segway-ecc"
_LEAST_FREE_MIB: Final = 4096
_PLATFORM: Final = "2"
"""Changes where what is made of the same packages changes, so that an older archive is not taken."""


def build_wheel(folder: Path, epoch: int) -> Path:
    """Our wheel from the checkout that this runs from.

    Raises:
        ImageError: It does not run from one, or pip fails.
    """
    if not (CHECKOUT / "pyproject.toml").exists():
        raise ImageError("this segway-ecc is installed and no checkout: give the wheel with --wheel FILE")
    _pip(["wheel", "--no-deps", "--wheel-dir", str(folder), str(CHECKOUT)], epoch)
    return next(folder.glob(WHEEL))


def collect_wheels(wheel: Path, recipe: Recipe, python: str) -> list[Path]:
    """What our wheel needs with the recipe's extras, from the cache or the index.

    Raises:
        ImageError: Something is not to be had, or this Python is not of the version of the image's.
    """
    ours = f"{sys.version_info.major}.{sys.version_info.minor}"
    if python != ours:
        raise ImageError(f"the image's Python is {python} and this one is {ours}: run the builder with Python {python}")
    folder = image_cache() / f"wheels-{python}-{'-'.join(sorted(recipe.extras)) or 'plain'}"
    kept = folder / ".requirements"
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        lines = archive.read(name).decode().splitlines()
    wanted = "\n".join([*sorted(recipe.extras), *(line for line in lines if line.startswith("Requires-Dist:"))])
    if not kept.exists() or kept.read_text("utf-8") != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        # Without it, a source distribution needs the package `wheel` here, which a virtual environment has not.
        what = [f"{wheel.resolve()}{extras_text(recipe.extras)}", "pip"]
        _pip(["wheel", "--use-pep517", "--wheel-dir", str(folder), *what], recipe.epoch)
        for own in folder.glob(WHEEL):
            own.unlink()
        kept.write_text(wanted, "utf-8")
    return sorted(folder.glob("*.whl"))


def install_wheels(root: Path, version: str, wheels: Sequence[Path]) -> None:
    """Make the release's virtual environment, with these wheels in it, with the image's own Python."""
    place = root / OPT / "releases" / version
    held = root / "tmp" / "wheels"
    if not (place / "venv").exists():
        inside(root, ["python3", "-I", "-m", "venv", "--without-pip", f"{folder_of(version)}/venv"])
    held.mkdir(parents=True)
    for wheel in wheels:
        shutil.copyfile(wheel, held / wheel.name)
    pip = next(path for path in held.glob("pip-*.whl"))
    names = [f"/tmp/wheels/{path.name}" for path in wheels]  # noqa: S108 - in the image, where nobody else is
    words = ["install", "--no-index", "--no-deps", "--no-compile", "--quiet", "--root-user-action=ignore", *names]
    inside(root, [f"{folder_of(version)}/venv/bin/python", "-I", f"/tmp/wheels/{pip.name}/pip", *words])  # noqa: S108
    shutil.rmtree(held)


def folder_of(version: str) -> str:
    """Where a release lies in the image."""
    return f"/{OPT}/releases/{version}"


def compile_python(root: Path, *folders: str) -> None:
    """Compile Python in the image: nothing can be compiled later, and a start takes twice as long without."""
    words = ["-m", "compileall", "-q", "--invalidation-mode", "unchecked-hash", *folders]
    inside(root, ["python3", *words], env={"PYTHONHASHSEED": "0"})


def complete_release(root: Path, version: str, epoch: int) -> None:
    """Write the release's manifest, and make it the one in use."""
    folder = root / OPT / "releases" / version
    write_environment(folder, Path(folder_of(version)))
    created = dt.datetime.fromtimestamp(epoch, dt.UTC).isoformat()
    manifest = ReleaseManifest(version, version, created, "image", entries_of(folder))
    dataclasses.replace(manifest, state=HEALTHY).write(folder)
    link = root / OPT / "current"
    link.unlink(missing_ok=True)
    link.symlink_to(f"releases/{version}")


def hashes_of(wheels: Sequence[Path]) -> dict[str, str]:
    """The SHA-256 of each wheel by its file name."""
    return {path.name: sha256_of(path) for path in sorted(wheels, key=lambda path: path.name)}


def _pip(words: Sequence[str], epoch: int) -> None:
    env = {key: value for key, value in os.environ.items() if key.startswith(("PIP_", "HTTP", "http"))}
    run(
        [sys.executable, "-P", "-m", "pip", *words, "--quiet", "--disable-pip-version-check"],
        env={**env, "SOURCE_DATE_EPOCH": str(epoch), "PATH": os.environ.get("PATH", "")},
    )


@dataclass(frozen=True, slots=True)
class Image:
    """Where an image lies: its root file system as a folder and as a file, and an empty data partition as a file.

    The manifest is what it was made of.
    """

    root: Path
    manifest: Path
    root_file_system: Path
    data_file_system: Path


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """What is wanted besides the recipe.

    Attributes:
        config: The configuration folder to begin with.
        wheel: Our wheel; None for that of this checkout.
        uml: Whether the modules of user-mode Linux go in.
        with_disk: Whether a disk is made.
        data_mib: The size of the data partition, MiB; None for the least that holds what it must.
    """

    config: Path | None = None
    wheel: Path | None = None
    uml: bool = False
    with_disk: bool = False
    data_mib: int | None = None


def build(recipe: Recipe, folder: Path, options: BuildOptions, on_step: Callable[[str], None]) -> Image:
    """Build an image into a folder, in place of an older one; `on_step` is called as each step begins.

    Raises:
        ImageError: Something it takes is missing, or failed.
    """
    if (lacking := missing()) is not None:
        raise ImageError(lacking)
    folder.mkdir(parents=True, exist_ok=True)
    if shutil.disk_usage(folder).free // disk.MIB < _LEAST_FREE_MIB:
        raise ImageError(f"{folder} has less than {_LEAST_FREE_MIB} MiB free")
    image = image_in(folder)
    shutil.rmtree(image.root, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix="segway-ecc-image-") as work:
        wheel = options.wheel or build_wheel(Path(work), recipe.epoch)
        wheels = _assemble(recipe, image.root, wheel, options, on_step)
        hashes, wheel_bytes = hashes_of(wheels), sum(path.stat().st_size for path in wheels)
    own = image.root / OPT / (image.root / OPT / "current").readlink()
    needed = disk.partition_content(own, wheel_bytes, image.root / tree.HELD_VAR, options.config)
    if options.data_mib is not None:
        needed.check(options.data_mib)
    on_step("manifest")
    write_manifest(image.manifest, recipe, installed_packages(image.root), hashes, image.root)
    on_step("file systems")
    disk.root_file_system(image.root, image.root_file_system, recipe.epoch)
    disk.data_file_system(image.data_file_system, options.data_mib or needed.mib, recipe.epoch)
    if options.with_disk:
        config = folder / "config.ext4"
        disk.config_file_system(image.root / "config", config, recipe.epoch)
        disk.disk(folder / "disk.img", [image.root_file_system, image.data_file_system, config])
        config.unlink()
        for name in ("vmlinuz", "initrd.img"):
            for found in sorted((image.root / "boot").glob(f"{name}-*"))[-1:]:
                shutil.copyfile(found, folder / name)
    return image


def image_in(folder: Path) -> Image:
    """The image that lies in a folder."""
    return Image(folder / "root", folder / MANIFEST, folder / "root.ext4", folder / "data.ext4")


def _assemble(
    recipe: Recipe, root: Path, wheel: Path, options: BuildOptions, on_step: Callable[[str], None]
) -> list[Path]:
    """Make the root file system; returns the wheels that its release is made of."""
    version = wheel.name.split("-")[1]
    on_step("Debian packages")
    base = base_archive(recipe)
    on_step("Python packages")
    kept = base.with_suffix(".python")  # the version of the image's Python, such as 3.11
    if not kept.exists():
        with tempfile.TemporaryDirectory(prefix="base-", dir=image_cache()) as work:
            tree.unpack(base, Path(work) / "root")
            show = "import sys; print('%d.%d' % sys.version_info[:2])"
            kept.write_text(inside(Path(work) / "root", ["python3", "-c", show]).strip(), "ascii")
    others = collect_wheels(wheel, recipe, kept.read_text("ascii"))
    tree.unpack(_platform(base, version, others), root)
    on_step("our release and its services")
    ours = [wheel, *(path for path in others if path.name.startswith("pip-"))]
    install_wheels(root, version, ours)
    compile_python(root, folder_of(version))
    complete_release(root, version, recipe.epoch)
    tree.furnish(root, recipe, options.config)
    if options.uml:
        tree.uml_modules(root)
    tree.finish(root, recipe.epoch)
    return [wheel, *others]


def _platform(base: Path, version: str, wheels: Sequence[Path]) -> Path:
    """The archive with all that our wheel needs, kept: it changes with the dependencies only."""
    parts = [_PLATFORM, base.name, version, *(f"{name} {digest}" for name, digest in hashes_of(wheels).items())]
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
    archive = image_cache() / f"platform-{digest}.tar"
    if not archive.exists():
        with tempfile.TemporaryDirectory(prefix="platform-", dir=image_cache()) as work:
            root = Path(work) / "root"
            tree.unpack(base, root)
            install_wheels(root, version, wheels)
            # As Debian's Python comes, each start reads every source to see that it is the same.
            debian = sorted((root / "usr" / "lib").glob("python3*"))
            compile_python(root, folder_of(version))
            compile_python(root, *(f"/{path.relative_to(root)}" for path in debian))
            tree.pack(root, archive)
    return archive
