# SPDX-License-Identifier: MIT
"""What goes wrong with a connection, and what it is called."""

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.deploy.release.host import BOOTSTRAP, Host, UnreachableError, UpdateRefusedError
from segway_ecc.deploy.release.requests import status
from segway_ecc.deploy.verbs.deploy_status import rules
from segway_ecc.node.cli.main import main
from segway_ecc.node.errors import ConfigurationError
from tests.deploy.release.robot import Robot, Sshd


@pytest.mark.parametrize("address", ["", "-oProxyCommand=evil", "a b", "a\nb"])
def test_what_is_no_host_is_refused(address: str) -> None:
    with pytest.raises(ConfigurationError, match="is no host"):
        Host(address)


def test_nobody_there(tmp_path: Path) -> None:
    (tmp_path / "config").write_text("Host gone\n HostName 127.0.0.1\n Port 1\n")
    assert main(["deploy", "status", "gone", "--ssh-config", str(tmp_path / "config")]) == 6


def test_an_unknown_host_key_is_refused(sshd: Sshd, tmp_path: Path) -> None:
    text = sshd.config.read_text().replace("UserKnownHostsFile", f"UserKnownHostsFile {tmp_path}/none #")
    (tmp_path / "config").write_text(text)
    with (
        Host("robot", config=tmp_path / "config") as host,
        pytest.raises(UnreachableError, match="verification failed"),
    ):
        status(host, verify=False)


def test_old_python_on_the_robot_is_refused_with_its_version() -> None:
    old = BOOTSTRAP.replace("sys.version_info <", "(3, 10, 2) <").replace("sys.version_info[:2]", "(3, 10)")
    done = subprocess.run([sys.executable, "-c", old], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (11, "its python3 is 3.10, and 3.11 or later is needed\n")


def test_names_and_paths_reach_the_robot_as_they_are(
    sshd: Sshd, tmp_path: Path, module_robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    evil = f"{tmp_path}/a b'; touch {tmp_path}/evil; \"$(touch {tmp_path}/evil)"
    code = main(["deploy", "status", "robot", "--ssh-config", str(sshd.config), "--root", evil, "--config", evil])
    assert (code, (tmp_path / "evil").exists()) == (0, False)
    assert "no release in use" in capsys.readouterr().out
    assert module_robot.store.complete() == []


def test_login_output_of_the_robots_shell_is_ignored(ssh_host: Host, module_robot: Robot) -> None:
    real = ssh_host.command()

    class Chatty(Host):
        def command(self, *options: str) -> list[str]:
            return [*real, "echo Welcome; echo 1; echo '[]';"] if not options else ["true"]

    with Chatty("robot", root=str(module_robot.root), robot_config=str(module_robot.config)) as host:
        found = status(host, verify=False)
    assert found["current"] is None


def test_a_robot_without_python(ssh_host: Host) -> None:
    real = ssh_host.command()

    class Bare(Host):
        def command(self, *options: str) -> list[str]:
            return [*real, "PATH=/nonexistent;"] if not options else ["true"]

    with Bare("robot") as host, pytest.raises(UpdateRefusedError, match="it has no python3"):
        status(host, verify=False)


def test_a_command_with_an_open_quotation_is_refused() -> None:
    options = argparse.Namespace(trial=10.0, start=30.0, keep=3, restart="a 'b c'")
    assert list(rules(options).restart) == ["a", "b c"]
    options.restart = "a 'b"
    with pytest.raises(ConfigurationError, match="--restart"):
        rules(options)


@pytest.mark.parametrize("words", [["--trial", "0"], ["--start", "nan"], ["--keep", "0"], ["--wheel", "x.whl"]])
def test_arguments_out_of_range(words: list[str]) -> None:
    assert main(["deploy", "push", "nowhere.invalid", *words]) == 2
