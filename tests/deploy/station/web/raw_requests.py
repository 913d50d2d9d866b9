# SPDX-License-Identifier: MIT
"""Asking the server, byte for byte where it matters."""

import asyncio
import contextlib
import os
from pathlib import Path
from typing import Any

from tests.patience import PATIENCE_S


def logs(folder: Path) -> None:
    """What lies around a log that may be fetched."""
    (folder / "logs" / "folder").mkdir(parents=True)
    (folder / "access.json").write_text("secret")
    for name in ("a.mcap", ".hidden", "folder/inner"):
        (folder / "logs" / name).write_bytes(b"0123456789")
    (folder / "logs" / "link").symlink_to(folder / "access.json")
    os.mkfifo(folder / "logs" / "pipe")


async def raw(port: int, request: bytes) -> tuple[int, str]:
    """Send some bytes; the status of the answer, and all of it."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(request)
        async with asyncio.timeout(PATIENCE_S):
            answer = await reader.read(4096)
    finally:
        await hang_up(writer)
    status = answer.split(b" ", 2)[1] if answer.startswith(b"HTTP/") else b"0"
    return int(status), answer.decode("latin-1")


async def hang_up(writer: asyncio.StreamWriter) -> None:
    writer.close()
    with contextlib.suppress(ConnectionError):
        await writer.wait_closed()


async def still_answers(client: Any) -> None:
    async with client.get("/health") as answer:
        assert (answer.status, await answer.text()) == (200, "ok\n")


async def login(client: Any, token: str) -> int:
    async with client.post("/login", json={"name": "ann", "token": token}) as answer:
        return int(answer.status)
