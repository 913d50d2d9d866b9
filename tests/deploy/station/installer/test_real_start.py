# SPDX-License-Identifier: MIT
"""The command, with a systemctl that starts what the rendered unit says, as this user."""

import json
import os
import signal
import sys
import textwrap
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.station.installer.checks import wait_until_healthy
from segway_ecc.deploy.station.web.site_address import bind
from tests.deploy.station.installer.conftest import Fake, Outcome

# What systemd does with a unit, as far as a start needs it.
SYSTEMCTL = """\
#!{python}
import os, re, shlex, subprocess, sys
from pathlib import Path

root = Path({root!r})
if "restart" not in sys.argv:
    sys.exit(0)
lines = (root / "etc/systemd/system" / sys.argv[-1]).read_text().splitlines()
values = [line.partition("=")[::2] for line in lines if not line.startswith("#")]
here = lambda text: re.sub(r"(?<!\\w)/var/(lib|log)", str(root) + r"/var/\\1", text)
pairs = [word for name, value in values if name == "Environment" for word in shlex.split(value)]
for name, value in values:
    path = root / value.lstrip("-/")
    if name == "EnvironmentFile" and (path.exists() or not value.startswith("-")):
        pairs += shlex.split(path.read_text(), comments=True)
own = dict(here(pair).split("=", 1) for pair in pairs)
(start,) = [value for name, value in values if name == "ExecStart"]
words = []
for word in shlex.split(here(start)):
    words += shlex.split(own[word[1:]]) if word.startswith("$") else [word]
for name in ("ROS_LOG_DIR", "ROS_HOME", "HOME"):
    Path(own[name]).mkdir(parents=True, exist_ok=True)
with open(root / "journal", "wb") as journal:
    streams = {{"stdout": journal, "stderr": journal}}
    process = subprocess.Popen(words, env={{**os.environ, **own}}, start_new_session=True, **streams)
(root / "pid").write_text(str(process.pid))
"""


@pytest.fixture
def real(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> Iterator[Fake]:
    """The machine, with a program of its own that is this environment's, and a systemctl that starts it."""
    monkeypatch.setattr("segway_ecc.deploy.station.installer.install.wait_until_healthy", wait_until_healthy)
    program = Path(sys.executable).with_name("segway-ecc")
    link = fake.root / str(program)[1:]
    link.parent.mkdir(parents=True)
    link.symlink_to(program)
    path = fake.bin / "systemctl"
    path.write_text(textwrap.dedent(SYSTEMCTL.format(python=sys.executable, root=str(fake.root))))
    yield fake
    pid = fake.root / "pid"
    if pid.exists():
        os.killpg(int(pid.read_text()), signal.SIGKILL)


def _post(address: str, token: str) -> int:
    body = json.dumps({"name": "ann", "token": token}).encode()
    request = urllib.request.Request(address, body, {"Content-Type": "application/json"})  # noqa: S310 - our own
    with urllib.request.urlopen(request, timeout=30.0) as answer:  # noqa: S310 - our own
        return int(answer.status)


@pytest.mark.ros
def test_rendered_service_accepts_token(base_station: Callable[..., Outcome], real: Fake) -> None:
    (bound,) = bind("127.0.0.1", 0)
    port = bound.getsockname()[1]
    bound.close()
    outcome = base_station("--port", str(port), "--domain", "97", "--discovery", "localhost")
    assert outcome.code == 0, [*outcome.errors, real.text("journal")]
    assert f"ExecStart={Path(sys.executable).with_name('segway-ecc')} station serve " in real.text(
        "/etc/systemd/system/segway-ecc-station.service"
    )
    page = outcome.out.splitlines()[0].split()[1]
    assert page == f"http://127.0.0.1:{port}/"
    with urllib.request.urlopen(f"{page}health", timeout=30.0) as answer:  # noqa: S310 - our own
        assert answer.read() == b"ok\n"
    operator, viewer = (line.split()[1] for line in outcome.errors[1:3])
    assert [_post(f"{page}login", token) for token in (operator, viewer)] == [204, 204]
    for wrong in ("", operator[:-1]):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            _post(f"{page}login", wrong)
    assert "operator" not in real.text("journal")  # it found the tokens, and made none of its own
