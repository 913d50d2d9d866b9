# SPDX-License-Identifier: MIT
"""A robot to deploy to: a real sshd on loopback where a test asks for it, and a stand-in for systemd."""

import getpass
import os
import pwd
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.release.host import Host
from tests.deploy.release.robot import LocalHost, Robot, Sshd, make_robot


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return make_robot(tmp_path / "robot")


@pytest.fixture(scope="module")
def module_robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """One robot for all tests of a module: what a test leaves is what the next begins with, as in life."""
    return make_robot(tmp_path_factory.mktemp("module") / "robot")


def _port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _key(path: Path) -> None:
    subprocess.run(
        [shutil.which("ssh-keygen") or "ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", path], check=True
    )


@pytest.fixture(scope="module")
def sshd(module_robot: Robot) -> Iterator[Sshd]:
    program = shutil.which("sshd", path=f"{os.environ['PATH']}:/usr/sbin")
    if program is None:
        (pytest.fail if "CI" in os.environ else pytest.skip)("no sshd: sudo apt-get install openssh-server")
    if pwd.getpwuid(os.geteuid()).pw_shell.endswith(("/nologin", "/false")):
        pytest.skip(f"nobody can log in as {getpass.getuser()}, whose shell is none")
    folder, port = module_robot.folder / "ssh", _port()
    (folder / "home").mkdir(parents=True)
    for name in ("host", "user"):
        _key(folder / name)
    if is_root := os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # sshd separates its privileges there
    # Without PAM sshd refuses an account that has no password.
    pam = "no" if is_root else "yes"
    (folder / "sshd_config").write_text(
        f"ListenAddress 127.0.0.1:{port}\nHostKey {folder}/host\nPidFile none\nAuthorizedKeysFile {folder}/user.pub\n"
        f"StrictModes no\nUsePAM {pam}\nPasswordAuthentication no\nPermitRootLogin prohibit-password\n"
        f"SetEnv PATH={module_robot.folder}/bin:/usr/bin:/bin HOME={folder}/home\n"
    )
    host_key = (folder / "host.pub").read_text()
    (folder / "known_hosts").write_text(f"[127.0.0.1]:{port} {host_key}")
    (folder / "config").write_text(
        f"Host robot\n HostName 127.0.0.1\n Port {port}\n User {getpass.getuser()}\n IdentityFile {folder}/user\n"
        f" IdentitiesOnly yes\n UserKnownHostsFile {folder}/known_hosts\n StrictHostKeyChecking yes\n"
    )
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen([program, "-D", "-e", "-f", folder / "sshd_config"], stderr=log)
    while b"listening" not in (folder / "log").read_bytes():
        assert process.poll() is None, (folder / "log").read_text()
        time.sleep(0.01)
    yield Sshd(folder / "config", process.pid)
    process.terminate()
    process.wait()


@pytest.fixture
def ssh_host(sshd: Sshd) -> Iterator[Host]:
    with Host("robot", config=sshd.config) as host:
        yield host


@pytest.fixture
def local(robot: Robot) -> Iterator[LocalHost]:
    with LocalHost(robot) as host:
        yield host
