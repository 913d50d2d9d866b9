# SPDX-License-Identifier: MIT
import importlib.util
import json
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.web.site_address import SiteAddress, bind, site_address_of, url
from segway_ecc.deploy.verbs import station_serve
from tests.command import Outcome
from tests.patience import PATIENCE_S

SegwayEcc = Callable[..., Outcome]


@pytest.fixture
def has_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is refused before ROS is spoken is refused on machines without it too."""
    monkeypatch.setattr(station_serve, "require_station", lambda: None)


@pytest.mark.usefixtures("has_ros")
@pytest.mark.parametrize(
    ("words", "output"),
    [
        (["--port", "70000"], "--port is 0 to 65535"),
        (["--key", "k.pem"], "--key is of no use without --certificate"),
        (["--certificate", "nowhere.pem"], "--certificate nowhere.pem cannot be used: No such file or directory"),
        (["--address", "192.0.2.1"], "--address 192.0.2.1 --port 8700 cannot be listened on"),
        (["--port", "0", "--folder", "/dev/null/x"], "--folder /dev/null/x cannot be made: Not a directory"),
    ],
)
def test_invalid_arguments_are_reported_in_one_line(segway_ecc: SegwayEcc, words: list[str], output: str) -> None:
    outcome = segway_ecc("station", "serve", *words)
    assert outcome.code == 2
    (line,) = outcome.errors
    assert output in line


@pytest.mark.usefixtures("has_ros")
def test_port_in_use_is_reported(segway_ecc: SegwayEcc) -> None:
    (taken,) = bind("127.0.0.1", 0)
    with taken:
        outcome = segway_ecc("station", "serve", "--port", str(taken.getsockname()[1]))
    assert outcome.code == 2
    assert outcome.errors[0].endswith("cannot be listened on: Address already in use")
    assert len(outcome.errors) == 1


@pytest.mark.usefixtures("has_ros")
def test_invalid_certificate_or_key_with_passphrase_is_reported(segway_ecc: SegwayEcc, tmp_path: Path) -> None:
    (tmp_path / "none.pem").write_text("nothing")
    assert "cannot be used" in segway_ecc("station", "serve", "--certificate", str(tmp_path / "none.pem")).errors[0]
    kind = ["-x509", "-newkey", "rsa:2048", "-days", "2", "-subj", "/CN=base", "-passout", "pass:secret"]
    files = ["-keyout", str(tmp_path / "key.pem"), "-out", str(tmp_path / "c.pem")]
    subprocess.run(["openssl", "req", *kind, *files], check=True, capture_output=True)  # noqa: S607 - wherever it is
    words = ["--certificate", str(tmp_path / "c.pem"), "--key", str(tmp_path / "key.pem")]
    outcome = segway_ecc("station", "serve", *words)  # and it does not ask at the terminal
    assert outcome.code == 2
    assert "cannot be used" in outcome.errors[0]


def test_without_aiohttp_it_names_the_extra(segway_ecc: SegwayEcc, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "aiohttp" else find(name))
    outcome = segway_ecc("station", "serve")
    assert outcome.code == 2
    assert "pip install 'segway-ecc[station]'" in outcome.errors[0]
    assert len(outcome.errors) == 1


def test_missing_ros_is_reported(segway_ecc: SegwayEcc, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.node.ros.runtime.missing_packages", lambda: ["rclpy"])
    outcome = segway_ecc("station", "serve", "--port", "0")
    assert outcome.code == 5
    (line,) = outcome.errors
    assert "rclpy" in line
    assert "segway-ecc[ros]" in line


def test_importing_the_verb_needs_no_aiohttp() -> None:
    code = "import sys; sys.modules['aiohttp'] = None; import segway_ecc.deploy.verbs.station_serve"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_loopback_is_known_by_every_name_of_it_and_a_network_by_this_machine_s() -> None:
    (loopback,) = bind("127.0.0.1", 0)
    (everywhere,) = bind("0.0.0.0", 0)  # noqa: S104 - what is tested
    with loopback, everywhere:
        place = site_address_of([loopback], "http", [])
        assert (place.is_loopback, place.port, place.names) == (True, loopback.getsockname()[1], frozenset())
        place = site_address_of([everywhere], "https", ["Base.Example."])
        assert not place.is_loopback
        assert {"base.example", socket.gethostname().lower()} <= place.names
        assert not site_address_of([loopback, everywhere], "http", []).is_loopback


def test_what_to_open() -> None:
    assert url("127.0.0.1", SiteAddress("http", 8700)) == "http://127.0.0.1:8700/"
    assert url("::1", SiteAddress("https", 1)) == "https://[::1]:1/"
    assert url("0.0.0.0", SiteAddress("http", 1)) == f"http://{socket.gethostname()}:1/"  # noqa: S104 - a text


class Running:
    """The verb in a process of its own."""

    def __init__(self, *words: str) -> None:
        command = [
            sys.executable,
            "-P",
            "-m",
            "segway_ecc.node.cli.main",
            "station",
            "serve",
            "--port",
            "0",
            "--json",
            *words,
        ]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.output: list[str] = []
        self.url = self._read_until("open ")

    def _read_until(self, what: str) -> str:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.output.append(line.strip())
            if what in line:
                return line.partition(what)[2].strip()
        raise AssertionError(self.output)

    def end(self, number: signal.Signals) -> tuple[int, dict[str, Any]]:
        self.process.send_signal(number)
        out, _ = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, json.loads(out)


def _get(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=10.0) as answer:  # noqa: S310 - our own
        content: bytes = answer.read()
        return content


@pytest.mark.ros
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_a_signal_and_reports(number: signal.Signals, tmp_path: Path) -> None:
    running = Running("--folder", str(tmp_path))
    try:
        assert _get(running.url + "health") == b"ok\n"
        assert b"<title>Base station</title>" in _get(running.url)
        with pytest.raises(urllib.error.HTTPError, match="404"):
            _get(running.url + "nothing")
        code, report = running.end(number)
    finally:
        running.process.kill()
        running.process.communicate()
    assert code == 0
    assert report == {"ended_by": number.name, "refused": {"not found": 1}, "station_refused": {}, "audit_lost": 0}
    acts = [json.loads(line)["act"] for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
    assert acts == ["starts", "ends"]
    assert not (tmp_path / "access.json").exists()


@pytest.mark.ros
def test_a_network_gets_tokens_once_and_a_warning_about_plain_http(tmp_path: Path) -> None:
    output = []
    for more in ([], [], ["--new-tokens"]):
        running = Running("--address", "0.0.0.0", "--folder", str(tmp_path), *more)  # noqa: S104 - what is tested
        try:
            port = running.url.strip("/").rpartition(":")[2]
            with pytest.raises(urllib.error.HTTPError, match="401"):
                _get(f"http://127.0.0.1:{port}/logs")
            running.end(signal.SIGTERM)
        finally:
            running.process.kill()
            running.process.communicate()
        output.append(running.output)
    first, second, third = output
    assert [line.split()[0] for line in first[1:3]] == ["operator", "viewer"]
    assert all(any("plain HTTP" in line for line in lines) for lines in output)
    assert not any("operator" in line for line in second)
    assert third[1:3] != first[1:3]
    kept = (tmp_path / "access.json").read_text()
    assert not any(line.split()[-1] in kept for line in third[1:3])
