# SPDX-License-Identifier: MIT
"""What browsers see and what they may do, over a real socket."""

import asyncio
import json
import ssl
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.deploy.station.views import Act
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.site_address import tls_context
from tests.deploy.station.web.scripted_station import full_robot
from tests.deploy.station.web.serving import browser, closed, command, drive, receive, served
from tests.deploy.station.web.socket_helpers import asked, until
from tests.patience import PATIENCE_S

Tried = Callable[[str, str], None]
OPERATOR, VIEWER = Role.OPERATOR, Role.VIEWER


def test_new_socket_receives_hello_events_and_picture(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path, tokens=True) as here, browser(here, "ann", VIEWER) as client:
            here.station.happen("before")
            await asyncio.sleep(0.05)
            async with client.ws_connect("/socket") as socket:
                hello = await receive(socket, "hello")
                assert hello == {
                    "kind": "hello",
                    "who": "ann",
                    "role": "viewer",
                    "version": "0",
                    "drive_period_s": 0.1,
                    "max_linear": 1.0,
                    "max_angular": 2.0,
                    "fresh_s": 1.0,
                    "trials": [],
                }
                assert (await receive(socket, "event"))["text"] == "before"
                first, second = (await receive(socket, "fleet"))["time_s"], (await receive(socket, "fleet"))["time_s"]
                assert second > first
                here.station.happen("after")
                assert (await receive(socket, "event"))["text"] == "after"

    asyncio.run(scenario())


def test_a_command_reaches_the_robots_and_its_reply_the_browser_and_both_the_audit_log(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client:
            async with client.ws_connect("/socket") as socket:
                here.station.answer = (False, "not upright")
                reply = await asked(socket, command(7))
                assert reply == {"kind": "reply", "id": 7, "is_accepted": False, "text": "not upright"}
                await socket.send_str(drive(8, 0.5))
                await socket.send_str(drive(9, 0.25))
                await socket.send_str(drive(10, 0.0))
                await until(lambda: len(here.station.drives) == 3)
            assert [(who, command.act) for who, command in here.station.commands] == [("ann", Act.ARM)]
            assert [each.linear for _, each in here.station.drives] == [0.5, 0.25, 0.0]
            entries = [entry for entry in await here.audit() if entry.get("robot") == "/alice"]
            reported = [(entry["act"], entry["outcome"], entry.get("text", ""), entry["number"]) for entry in entries]
            assert reported == [
                ("arm", "asked", "", 7),
                ("arm", "failed", "not upright", 7),
                ("drive", "asked", "0.5 m/s, 0 rad/s", 8),
                ("rest", "done", "", 10),
            ]
            assert all((entry["who"], entry["address"]) == ("ann", "127.0.0.1") for entry in entries)

    asyncio.run(scenario())


def test_a_browser_that_goes_while_it_drives_brings_the_robot_to_rest(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client:
            first = await client.ws_connect("/socket")
            second = await client.ws_connect("/socket")
            await first.send_str(drive(1, 0.5))
            await until(lambda: here.station.drives)
            await first.close()
            await until(lambda: len(here.station.drives) == 2)
            who, rest = here.station.drives[-1]
            assert (who, rest.robot, rest.linear, rest.angular) == ("ann", "/alice", 0.0, 0.0)
            assert here.station.gone == []  # another page of hers is open
            await second.close()
            await until(lambda: here.station.gone == ["ann"])

    asyncio.run(scenario())


@pytest.mark.parametrize(
    ("what", "message", "cause"),
    [
        ("a message that is no JSON", "{", "malformed"),
        ("a message of a kind that is not there", '{"kind": "shell", "id": 1}', "malformed"),
        ("a message with an unknown field", command(1, sudo=True), "malformed"),
        ("a speed that is not a number (NaN)", drive(1, 0.0).replace('"linear":0.0', '"linear":NaN'), "malformed"),
        ("a speed without end (1e999)", drive(1, 0.0).replace('"linear":0.0', '"linear":1e999'), "malformed"),
        ("a speed beyond the limit", drive(1, 1.5), "out of range"),
        ("a negative id", command(-1), "out of range"),
        ("a sequence of 65 KiB", command(1, "play", text="x" * 66_000), "oversized"),
        ("a message of 200 KiB", command(1) + " " * 200_000, "oversized"),
    ],
)
def test_a_message_that_is_none_is_refused(what: str, message: str, cause: str, tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client, client.ws_connect("/socket") as socket:
            reply = await asked(socket, message)
            assert not reply["is_accepted"]
            assert here.refused() == {cause: 1}
            assert (here.station.commands, here.station.drives) == ([], [])
            assert (await asked(socket, command(2)))["is_accepted"]  # the socket is still good
        tried(what, f"refused with a reply, counted as {cause}")

    asyncio.run(scenario())


def test_bytes_are_no_message(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client, client.ws_connect("/socket") as socket:
            await socket.send_bytes(command(1).encode())
            assert not (await receive(socket, "reply"))["is_accepted"]
            assert here.refused() == {"malformed": 1}
        tried("a message of bytes instead of text", "refused with a reply, counted as malformed")

    asyncio.run(scenario())


def test_a_message_of_a_megabyte_is_not_even_read(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client, client.ws_connect("/socket") as socket:
            await socket.send_str("x" * 1_000_000)
            code, _ = await closed(socket)
            assert code == 1009
            await until(lambda: here.refused() == {"oversized": 1})
            await until(lambda: here.station.gone == ["ann"])
        tried("a message of a megabyte", "the socket is closed with 1009, counted as oversized")

    asyncio.run(scenario())


def test_a_command_that_is_repeated_is_refused(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client, client.ws_connect("/socket") as socket:
            assert (await asked(socket, command(5)))["is_accepted"]
            for replayed in (command(5), command(4), drive(5, 0.5)):
                assert not (await asked(socket, replayed))["is_accepted"]
            assert here.refused() == {"replayed command": 3}
            assert len(here.station.commands) == 1
            assert here.station.drives == []
            assert (await asked(socket, command(6)))["is_accepted"]
        tried("a command sent again, with its id or an older one", "refused with a reply, counted as replayed command")

    asyncio.run(scenario())


def test_viewer_commands_are_refused_and_audited(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, tokens=True) as here,
            browser(here, "vic", VIEWER) as client,
            client.ws_connect("/socket") as socket,
        ):
            refused = [act for act in Act if act is not Act.STOP]
            for number, act in enumerate(refused, 1):
                reply = await asked(socket, command(number, act))
                assert (reply["is_accepted"], reply["text"]) == (False, "a viewer may only watch and stop")
            await asked(socket, drive(100, 0.5))
            assert here.refused() == {"viewer": len(refused) + 1}
            assert (here.station.commands, here.station.drives) == ([], [])
            assert (await receive(socket, "fleet"))["robots"] == []
            refusals = [entry for entry in await here.audit() if entry["outcome"] == "refused"]
            assert [entry["act"] for entry in refusals] == [*refused, "drive"]
        tried("every command but a stop and a set-point as a viewer", "refused with a reply, in the audit log")

    asyncio.run(scenario())


def test_viewer_may_stop(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, tokens=True) as here,
            browser(here, "vic", VIEWER) as client,
            client.ws_connect("/socket") as socket,
        ):
            assert (await asked(socket, command(1, Act.STOP)))["is_accepted"]
            assert [(who, given.act) for who, given in here.station.commands] == [("vic", Act.STOP)]
            entries = [entry for entry in await here.audit() if entry["act"] == "stop"]
            assert [(entry["who"], entry["role"], entry["outcome"]) for entry in entries] == [
                ("vic", "viewer", "asked"),
                ("vic", "viewer", "accepted"),
            ]
        tried("a stop as a viewer", "carried out, in the audit log")

    asyncio.run(scenario())


def test_logout_closes_sockets(tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        async with served(tmp_path, tokens=True) as here, browser(here, "ann", OPERATOR) as client:
            socket = await client.ws_connect("/socket")
            async with client.post("/logout", json={}):
                pass
            code, reason = await closed(socket)
            assert (code, reason) == (1008, "the session is over; log in again")
            await until(lambda: here.station.gone == ["ann"])
        tried("an open socket after log-out", "closed within a second")

    asyncio.run(scenario())


def test_station_shutdown_closes_sockets_with_reason(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here, "ann") as client:
            socket = await client.ws_connect("/socket")
            ending = asyncio.create_task(here.server.__aexit__(None, None, None))
            assert await closed(socket) == (1001, "the station ends")
            await ending
            assert here.station.gone == ["ann"]

    asyncio.run(scenario())


def test_two_browsers_are_two_operators_and_two_pages_of_one_are_one(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here) as one, browser(here) as two:
            names = []
            for client in (one, two, one):
                async with client.ws_connect("/socket") as socket:
                    names.append((await receive(socket, "hello"))["who"])
            assert names == ["operator", "operator 2", "operator"]

    asyncio.run(scenario())


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tls")
    kind = ["-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    names = ["-subj", "/CN=base", "-addext", "subjectAltName=IP:127.0.0.1"]
    files = ["-keyout", str(folder / "key.pem"), "-out", str(folder / "c.pem")]
    subprocess.run(["openssl", "req", *kind, *names, *files], check=True, capture_output=True)  # noqa: S607 - wherever it is
    return folder


def test_inside_tls(tmp_path: Path, certificate: Path, tried: Tried) -> None:
    async def scenario() -> None:
        context = tls_context(certificate / "c.pem", certificate / "key.pem")
        trust = ssl.create_default_context(cafile=str(certificate / "c.pem"))
        async with served(tmp_path, tokens=True, tls=context) as here, browser(here, ssl=trust) as client:
            token = here.tokens[OPERATOR]
            async with client.post("/login", json={"name": "ann", "token": token}) as answer:
                assert answer.status == 204
                assert "Secure" in answer.headers["Set-Cookie"]
                assert answer.headers["Strict-Transport-Security"] == "max-age=31536000"
            async with client.ws_connect("/socket") as socket:
                assert (await receive(socket, "hello"))["who"] == "ann"
            reader, writer = await asyncio.open_connection("127.0.0.1", here.port)
            writer.write(b"GET / HTTP/1.1\r\n\r\n")
            async with asyncio.timeout(PATIENCE_S):
                assert not (await reader.read()).startswith(b"HTTP")
            writer.transport.abort()
            await until(lambda: here.refused() == {"bad HTTP": 1})
        tried("plain HTTP where TLS is spoken", "closed, counted as bad HTTP")

    asyncio.run(scenario())


def test_json_is_what_the_views_say(tmp_path: Path) -> None:
    """The page reads these names."""

    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here) as client, client.ws_connect("/socket") as socket:
            here.station.robots = [full_robot("/robot1")]
            while not (fleet := await receive(socket, "fleet"))["robots"]:
                pass
            robot = fleet["robots"][0]
            assert (robot["robot"], robot["mode"], robot["controller"]) == ("/robot1", "ARMED", "")
            assert json.dumps(fleet)

    asyncio.run(scenario())
