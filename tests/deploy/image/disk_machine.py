# SPDX-License-Identifier: MIT
"""The disk that `segway-ecc deploy image --disk` makes, in QEMU with a real-time kernel and a network.

The machine is emulated, with no help of the host's processor: ten to fifty times slower than a real one. Its network is
QEMU's own, with DHCP; this host reaches the machine's ssh and the base station's page through ports of its own.
"""

import contextlib
import functools
import hashlib
import os
import shlex
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from segway_ecc.deploy.image import disk
from segway_ecc.deploy.image.build import BuildOptions, build, image_in
from segway_ecc.deploy.image.recipe import Recipe, image_cache
from segway_ecc.hil.kernels.guest import search_path
from tests.deploy.image.conftest import CONFIG, ROOT

PAGE_PORT: Final = 8700
# What the slow machine does in time; see the module.
SLOW_ROBOT: Final = {
    **{name: text.replace("step_size = 0.02", "step_size = 0.2") for name, text in CONFIG.items()},
    "environment": CONFIG["environment"].replace(" --no-ros", ""),
    "hostname": "robot-on-disk\n",
}
_PLAIN: Final = Recipe()
_RECIPE: Final = Recipe(packages=(*_PLAIN.packages, "nftables"), extras=("ros", "station"), vcan=True)
_DATA_MIB: Final = 3072
"""Three releases with ROS, each of which takes 350 MB."""
_SSH: Final = """Host robot
 HostName 127.0.0.1
 Port {port}
 User root
 IdentityFile {key}
 IdentitiesOnly yes
 StrictHostKeyChecking no
 UserKnownHostsFile /dev/null
 LogLevel ERROR
 ControlMaster auto
 ControlPath {folder}/control
 ControlPersist 60
"""
_KERNEL: Final = (
    "console=ttyS0 root=LABEL=segway-root ro init=/usr/lib/segway-ecc/init segway.data=LABEL=segway-data "
    "mitigations=off tsc=reliable"
)


class DiskMachineError(RuntimeError):
    """The machine did not do what was asked; with the end of its console."""


def _digest() -> str:
    content = hashlib.sha256(f"{_RECIPE}{SLOW_ROBOT}{_DATA_MIB}".encode())
    for package in ("deploy", "firmware_io", "hil", "node"):
        for path in sorted(path for path in (ROOT / package).rglob("*") if "__pycache__" not in path.parts):
            if path.is_file():
                content.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return content.hexdigest()[:16]


@functools.cache
def disk_folder() -> Path:
    """The folder with `disk.img`, its kernel, `key` to come in by ssh, and the image itself; kept for the next run."""
    folder = image_cache() / f"test-disk-{_digest()}"
    if (folder / "complete").exists():
        return folder
    for old in image_cache().glob("test-disk-*"):
        shutil.rmtree(old)
    folder.mkdir()
    subprocess.run([_program("ssh-keygen"), "-q", "-t", "ed25519", "-N", "", "-f", folder / "key"], check=True)
    with tempfile.TemporaryDirectory() as work:
        for name, text in {**SLOW_ROBOT, "authorized_keys": (folder / "key.pub").read_text()}.items():
            Path(work, name).parent.mkdir(exist_ok=True)
            Path(work, name).write_text(text, "utf-8")
        build(_RECIPE, folder, BuildOptions(config=Path(work), uml=True, with_disk=True), lambda _: None)
    _enlarge(folder)
    (folder / "complete").touch()
    return folder


def _enlarge(folder: Path) -> None:
    """The same disk with more room for data than is shipped."""
    image, config = image_in(folder), folder / "config.ext4"
    disk.data_file_system(image.data_file_system, _DATA_MIB, _RECIPE.epoch)
    disk.config_file_system(image.root / "config", config, _RECIPE.epoch)
    disk.disk(folder / "disk.img", [image.root_file_system, image.data_file_system, config])
    config.unlink()


class DiskMachine:
    """A machine that is running.

    Attributes:
        ssh_config: An ssh configuration by which it is `robot`.
        page: The base station's page, as this host reaches it; where the machine lets anybody in.
        began_s: When it was switched on, `time.monotonic()`.
    """

    def __init__(self, image: Path, folder: Path, masked: tuple[str, ...]) -> None:
        """Switch it on.

        Args:
            image: The disk, which is written.
            folder: Where its console is written.
            masked: Services that are not started.
        """
        folder.mkdir(parents=True, exist_ok=True)
        made = disk_folder()
        self._console = folder / "console"
        ssh, page = _free_port(), _free_port()
        self.ssh_config = folder / "ssh_config"
        # A short path: that of a socket has at most 108 characters.
        self._sockets = tempfile.TemporaryDirectory(prefix="disk-", ignore_cleanup_errors=True)
        text = _SSH.format(port=ssh, key=made / "key", folder=self._sockets.name)
        self.ssh_config.write_text(text, "ascii")
        self.page = f"http://127.0.0.1:{page}/"
        forward = f"hostfwd=tcp:127.0.0.1:{ssh}-:22,hostfwd=tcp:127.0.0.1:{page}-:{PAGE_PORT}"
        words = [
            *("setpriv", "--pdeathsig", "TERM", "qemu-system-x86_64", "-machine", "pc", "-accel", "tcg,thread=multi"),
            *("-cpu", "max,la57=off", "-smp", "2", "-m", "2G", "-display", "none", "-no-reboot"),
            *("-serial", f"file:{self._console}", "-drive", f"file={image},format=raw,if=virtio"),
            *("-kernel", str(made / "vmlinuz"), "-initrd", str(made / "initrd.img")),
            *("-netdev", f"user,id=net,{forward}", "-device", "virtio-net-pci,netdev=net"),
            *("-append", " ".join([_KERNEL, *(f"systemd.mask={name}.service" for name in masked)])),
        ]
        self.began_s = time.monotonic()
        with (folder / "qemu").open("wb") as output:
            self._process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env={"PATH": search_path()}
            )

    def run(self, command: str, timeout_s: float = 300.0, *, check: bool = True) -> str:
        """Run a shell command as root; returns its standard output. A status other than zero is an error."""
        words = ["ssh", "-F", str(self.ssh_config), "-o", "ConnectTimeout=20", "-o", "BatchMode=yes", "robot", command]
        try:
            done = subprocess.run(words, capture_output=True, text=True, timeout=timeout_s, check=False)
        except subprocess.TimeoutExpired:
            raise self._error(f"no answer within {timeout_s:g} s to: {command}") from None
        if check and done.returncode:
            raise self._error(f"status {done.returncode} of: {command}\n{done.stdout}{done.stderr}")
        return done.stdout

    def wait_until(self, command: str, timeout_s: float) -> float:
        """Wait until a command succeeds; when that was, s since it was switched on."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            with contextlib.suppress(DiskMachineError):
                self.run(command, 120.0)
                return time.monotonic() - self.began_s
            if time.monotonic() > deadline_s or self._process.poll() is not None:
                raise self._error(f"not within {timeout_s:g} s: {command}")
            time.sleep(0.5)

    def property(self, name: str, unit: str) -> str:
        """A property of a unit."""
        return self.run(f"systemctl show -P {shlex.quote(name)} {shlex.quote(unit)}").strip()

    def cut(self) -> None:
        """Take its power away."""
        self._process.kill()
        self._process.wait()
        self._sockets.cleanup()

    def _error(self, what: str) -> DiskMachineError:
        lines = self._console.read_text(errors="replace").splitlines()[-30:] if self._console.exists() else []
        return DiskMachineError(f"{what}; the console's last lines:\n" + "\n".join(lines))


@contextlib.contextmanager
def switched_on(image: Path, folder: Path, *masked: str) -> Iterator[DiskMachine]:
    """A machine that lets us in by ssh; its power is cut at the end. See `DiskMachine` for the arguments."""
    machine = DiskMachine(image, folder, masked)
    try:
        machine.wait_until("true", 900.0)
        yield machine
    finally:
        machine.cut()


@contextlib.contextmanager
def own_disk() -> Iterator[Path]:
    """A disk to write on, as it comes from the builder."""
    place = image_cache()  # on a disk: it may grow to gigabytes
    with tempfile.TemporaryDirectory(prefix="run-", dir=place) as folder:
        image = Path(folder) / "disk.img"
        # Of what is empty nothing is read.
        subprocess.run([_program("cp"), "--sparse=always", disk_folder() / "disk.img", image], check=True)
        yield image


def load() -> str:
    """How busy this host is, for whoever reads the figures."""
    return f"host load {os.getloadavg()[0]:.0f} on {os.cpu_count()} processors"


def _program(name: str) -> str:
    return shutil.which(name) or name


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
