# SPDX-License-Identifier: MIT
"""From a recipe to an image: a folder, a manifest, file systems, and a disk."""

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image import disk, release, tree
from segway_ecc.deploy.image.commands import ImageError, inside, missing
from segway_ecc.deploy.image.disk import partition_content
from segway_ecc.deploy.image.recipe import (
    MANIFEST,
    Recipe,
    base_archive,
    cache_folder,
    installed_packages,
    write_manifest,
)

_LEAST_FREE_MIB: Final = 4096
_PLATFORM: Final = "2"
"""Changes where what is made of the same packages changes, so that an older archive is not taken."""


@dataclass(frozen=True, slots=True)
class Image:
    """Where an image lies.

    Attributes:
        root: The root file system as a folder.
        manifest: What it was made of.
        root_file_system: The root file system as a file.
        data_file_system: An empty data partition.
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
        wheel = options.wheel or release.build_wheel(Path(work), recipe.epoch)
        wheels = _assemble(recipe, image.root, wheel, options, on_step)
        hashes, wheel_bytes = release.hashes_of(wheels), sum(path.stat().st_size for path in wheels)
    own = image.root / release.OPT / (image.root / release.OPT / "current").readlink()
    needed = partition_content(own, wheel_bytes, image.root / tree.HELD_VAR, options.config)
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
        with tempfile.TemporaryDirectory(prefix="base-", dir=cache_folder()) as work:
            tree.unpack(base, Path(work) / "root")
            show = "import sys; print('%d.%d' % sys.version_info[:2])"
            kept.write_text(inside(Path(work) / "root", ["python3", "-c", show]).strip(), "ascii")
    others = release.collect_wheels(wheel, recipe, kept.read_text("ascii"))
    tree.unpack(_platform(base, version, others), root)
    on_step("our release and its services")
    ours = [wheel, *(path for path in others if path.name.startswith("pip-"))]
    release.install_wheels(root, version, ours)
    release.compile_python(root, release.folder_of(version))
    release.complete_release(root, version, recipe.epoch)
    tree.furnish(root, recipe, options.config)
    if options.uml:
        tree.uml_modules(root)
    tree.finish(root, recipe.epoch)
    return [wheel, *others]


def _platform(base: Path, version: str, wheels: Sequence[Path]) -> Path:
    """The archive with all that our wheel needs, kept: it changes with the dependencies only."""
    parts = [_PLATFORM, base.name, version, *(f"{name} {digest}" for name, digest in release.hashes_of(wheels).items())]
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
    archive = cache_folder() / f"platform-{digest}.tar"
    if not archive.exists():
        with tempfile.TemporaryDirectory(prefix="platform-", dir=cache_folder()) as work:
            root = Path(work) / "root"
            tree.unpack(base, root)
            release.install_wheels(root, version, wheels)
            # As Debian's Python comes, each start reads every source to see that it is the same.
            debian = sorted((root / "usr" / "lib").glob("python3*"))
            release.compile_python(root, release.folder_of(version))
            release.compile_python(root, *(f"/{path.relative_to(root)}" for path in debian))
            tree.pack(root, archive)
    return archive
