# SPDX-License-Identifier: MIT
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from itertools import count
from pathlib import Path
from typing import ClassVar

import pytest

from segway_ecc.deploy.station.installer.checks import wait_until_healthy
from segway_ecc.deploy.station.installer.settings import InstallSettings
from segway_ecc.deploy.station.web.site_address import bind, tls_context
from segway_ecc.node.errors import NodeError


class _Handler(BaseHTTPRequestHandler):
    answers: ClassVar[list[tuple[int, bytes]]] = []
    paths: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        """Give the next answer, and the last one from then on."""
        self.paths.append(self.path)
        code, content = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        self.send_response(code)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Nothing."""


@pytest.fixture
def port() -> Iterator[int]:
    _Handler.answers.clear()
    _Handler.paths.clear()
    with HTTPServer(("127.0.0.1", 0), _Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        thread.join()


def wait(settings: InstallSettings) -> None:
    """Five attempts: each look at the clock is a second later."""
    seconds = count()
    wait_until_healthy(settings, 3_500_000_000, lambda: next(seconds) * 1_000_000_000, lambda _seconds: None)


def test_it_asks_until_the_station_is_well(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("http_proxy", "http://192.0.2.1:1")  # nobody's, and not to be used
    _Handler.answers.extend([(503, b""), (200, b"ok\n")])
    wait(InstallSettings(address="0.0.0.0", port=port))  # noqa: S104 - a text
    assert _Handler.paths == ["/health"] * 2


@pytest.mark.parametrize(
    ("answer", "output"), [((503, b""), "it answered 503"), ((200, b"<html>"), "something else answered")]
)
def test_unhealthy_station_raises_with_last_problem(port: int, answer: tuple[int, bytes], output: str) -> None:
    _Handler.answers.append(answer)
    with pytest.raises(NodeError, match=rf"within 3\.5 s \({output}\); see journalctl --unit segway-ecc"):
        wait(InstallSettings(port=port))
    assert len(_Handler.paths) == 4  # at 1, 2, 3 and 4 s: the last one after the time-out


def test_a_certificate_for_the_name_of_browsers_does_not_matter(tmp_path: Path) -> None:
    kind = ["-x509", "-newkey", "rsa:2048", "-days", "2", "-subj", "/CN=base", "-nodes"]
    files = ["-keyout", str(tmp_path / "k.pem"), "-out", str(tmp_path / "c.pem")]
    subprocess.run(["openssl", "req", *kind, *files], check=True, capture_output=True)  # noqa: S607 - wherever it is
    _Handler.answers[:] = [(200, b"ok\n")]
    with HTTPServer(("127.0.0.1", 0), _Handler) as server:
        server.socket = tls_context(tmp_path / "c.pem", tmp_path / "k.pem").wrap_socket(server.socket, server_side=True)
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        wait(InstallSettings(port=server.server_address[1], certificate=tmp_path / "c.pem", key=tmp_path / "k.pem"))
        thread.join()


def test_refused_connection_is_reported() -> None:
    (bound,) = bind("127.0.0.1", 0)
    port = bound.getsockname()[1]
    bound.close()
    with pytest.raises(NodeError, match="Connection refused"):
        wait(InstallSettings(port=port))
