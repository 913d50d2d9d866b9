# SPDX-License-Identifier: MIT
"""The root file system as a folder: packages, our release, services, and what makes it a robot's."""

import os
import shutil
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image.recipe import Recipe, inside, run

HELD_VAR: Final = "usr/share/segway-ecc/var"
"""What a new data partition begins with."""
_DEPLOY: Final = resources.files("segway_ecc.deploy")
_UNITS: Final = "usr/lib/systemd/system"
_FOLDERS: Final = {"systemd": _UNITS, "network": "usr/lib/systemd/network", "udev": "usr/lib/udev/rules.d"}
_FILES: Final = {
    "image/files/init": "usr/lib/segway-ecc/init",
    "image/files/segway-ecc-configure": "usr/lib/segway-ecc/configure",
    "image/files/segway-ecc-configure.service": f"{_UNITS}/segway-ecc-configure.service",
    "image/files/segway-ecc-hostkey.service": f"{_UNITS}/segway-ecc-hostkey.service",
    "image/files/wired.network": "usr/lib/systemd/network/89-wired.network",
    "image/files/journald.conf": "usr/lib/systemd/journald.conf.d/segway-ecc.conf",
    "image/files/sysctl.conf": "usr/lib/sysctl.d/50-segway-ecc.conf",
    "image/files/sshd.conf": "etc/ssh/sshd_config.d/segway-ecc.conf",
    "release/segway-ecc-settle.service": f"{_UNITS}/segway-ecc-settle.service",
}
_ENABLED: Final = (
    "segway-ecc-settle.service",
    "segway-ecc.target",
    "segway-ecc-node.service",
    "segway-ecc-guard.service",
    "segway-ecc-configure.service",
    "segway-ecc-hostkey.service",
    "systemd-networkd.service",
    "systemd-resolved.service",
    "ssh.service",
)
_MASKED: Final = (
    "apt-daily.timer",
    "apt-daily-upgrade.timer",
    "e2scrub_all.timer",
    "e2scrub_reap.service",
    "systemd-networkd-wait-online.service",
    "systemd-binfmt.service",
    "proc-sys-fs-binfmt_misc.automount",
)
_LEFT_BEHIND: Final = ("dev/null", "etc/resolv.conf", "etc/hostname", "etc/machine-id", "root/.bash_history")
_LEFT_IN: Final = (
    "etc/ssh/ssh_host_*",
    "var/log/*.log",
    "var/log/apt/*",
    "var/cache/ldconfig/*",
    "var/lib/apt/lists/*",
)
_UML_MODULES: Final = Path("/usr/lib/uml/modules")
_NEEDED_OF_UML: Final = ("kernel/net/can", "kernel/drivers/net/can", "kernel/fs/overlayfs", "kernel/fs/autofs")
_README: Final = """Files here are taken over into /etc at each boot: hostname, authorized_keys (of root, for ssh),
robot.yaml, environment, robot/* (models beside the robot file), network/* (for systemd-networkd).
"""


def unpack(archive: Path, root: Path) -> None:
    """Unpack a root file system; device files are left to the kernel."""
    root.mkdir(parents=True)
    run(["tar", "-C", str(root), "--numeric-owner", "--exclude=./dev/*", "-xf", str(archive)])
    (root / "dev" / "null").touch()  # for the programs that run in it while it is built


def pack(root: Path, archive: Path) -> None:
    """Pack a root file system."""
    part = archive.with_name(f".{os.getpid()}-{archive.name}")
    run(["tar", "-C", str(root), "--numeric-owner", "--sort=name", "-cf", str(part), "."])
    part.replace(archive)


def furnish(root: Path, recipe: Recipe, config: Path | None) -> None:
    """Add the services and their environment, and enable them."""
    _copy_files(root, recipe)
    shutil.rmtree(root / "config", ignore_errors=True)
    (root / "config").mkdir()
    if config is not None:
        shutil.copytree(config, root / "config", dirs_exist_ok=True)
    (root / "config" / "README").write_text(_README, "utf-8")
    inside(root, ["systemd-sysusers"])
    enabled = [*_ENABLED, *(["segway-ecc-archive.service"] if "ros" in recipe.extras else [])]
    inside(root, ["systemctl", "--quiet", "enable", *enabled])
    inside(root, ["systemctl", "--quiet", "mask", *_MASKED])


def uml_modules(root: Path) -> None:
    """Add the kernel modules that the image needs under user-mode Linux."""
    for release in _UML_MODULES.iterdir():
        place = root / "lib" / "modules" / release.name
        for name in _NEEDED_OF_UML:
            shutil.copytree(release / name, place / name)
        for path in release.glob("modules.[bo]*"):
            shutil.copy(path, place)
        run(["depmod", "--basedir", str(root), release.name])


def finish(root: Path, epoch: int) -> None:
    """Take away what the building left, put /var where a new data partition finds it, and stamp everything."""
    for name in _LEFT_BEHIND:
        (root / name).unlink(missing_ok=True)
    for pattern in _LEFT_IN:
        for found in root.glob(pattern):
            if found.is_dir() and not found.is_symlink():
                shutil.rmtree(found)
            else:
                found.unlink()
    (root / "etc" / "machine-id").touch()  # empty: made at the first boot, which is none in which units are preset
    (root / "etc" / "hostname").write_text("segway\n", "ascii")
    (root / "etc" / "resolv.conf").symlink_to("/run/systemd/resolve/stub-resolv.conf")
    held = root / HELD_VAR
    shutil.rmtree(held, ignore_errors=True)
    held.parent.mkdir(parents=True, exist_ok=True)
    (root / "var").rename(held)
    (root / "var").mkdir()
    # What is deeper first, so that stamping one leaves those above to come.
    for folder, folders, files in os.walk(root, topdown=False):
        links = [name for name in folders if Path(folder, name).is_symlink()]
        for path in (*(Path(folder, name) for name in (*files, *links)), Path(folder)):
            if path.lstat().st_mtime > epoch:
                os.utime(path, (epoch, epoch), follow_symlinks=False)


def _copy_files(root: Path, recipe: Recipe) -> None:
    """Copy our units, rules and settings to where the system reads them."""
    for folder, place in _FOLDERS.items():
        for source in sorted((_DEPLOY / folder).iterdir(), key=lambda path: path.name):
            name, _, kind = source.name.rpartition(".")
            target = root / place / source.name
            if kind == "conf":  # segway-ecc.sysusers.conf goes to sysusers.d
                target = root / "usr" / "lib" / f"{name.rpartition('.')[2]}.d" / "segway-ecc.conf"
            elif kind == "preset":
                target = root / "usr" / "lib" / "systemd" / "system-preset" / "50-segway-ecc.preset"
            if source.is_file() and (recipe.vcan or "vcan" not in source.name):
                _write(target, source)
    for name, place in _FILES.items():
        _write(root / place, _DEPLOY / name, 0o755 if place.startswith("usr/lib/segway-ecc/") else 0o644)
    modules = root / "usr/lib/modules-load.d/segway-ecc.conf"
    modules.parent.mkdir(parents=True, exist_ok=True)
    modules.write_text("can-raw\nvcan\n" if recipe.vcan else "can-raw\n", "ascii")
    (root / "etc" / "fstab").write_text("tmpfs /tmp tmpfs nosuid,nodev 0 0\n", "ascii")
    command = root / "usr" / "bin" / "segway-ecc"
    command.unlink(missing_ok=True)
    command.symlink_to("/opt/segway-ecc/current/venv/bin/segway-ecc")


def _write(target: Path, source: Traversable, mode: int = 0o644) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(source.read_bytes())
    target.chmod(mode)
