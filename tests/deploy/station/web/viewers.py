# SPDX-License-Identifier: MIT
"""Many browsers that look: `python viewers.py PORT COUNT SECONDS`; prints the pictures per second of each, as JSON."""

import asyncio
import sys
import time

import aiohttp
import msgspec


class Picture(msgspec.Struct):
    """All that a viewer needs of one."""

    time_s: float


async def _view(client: aiohttp.ClientSession, seconds: float, begin: asyncio.Barrier) -> float:
    async with client.ws_connect("/socket", max_msg_size=0) as socket:
        await begin.wait()
        begun_s, count = time.monotonic(), 0
        while time.monotonic() - begun_s < seconds:
            message = await socket.receive()
            if message.type is not aiohttp.WSMsgType.TEXT or not message.data.startswith('{"kind":"fleet"'):
                continue
            count += 1
            picture = msgspec.json.decode(message.data, type=Picture)
            await socket.send_str(msgspec.json.encode({"kind": "seen", "time_s": picture.time_s}).decode())
        return count / (time.monotonic() - begun_s)


async def main(port: int, count: int, seconds: float) -> None:
    url = f"http://127.0.0.1:{port}"
    begin = asyncio.Barrier(count)
    async with aiohttp.ClientSession(url, headers={"Origin": url}, connector=aiohttp.TCPConnector(limit=0)) as client:
        async with client.get("/session"):
            pass
        rates = await asyncio.gather(*(_view(client, seconds, begin) for _ in range(count)))
    sys.stdout.buffer.write(msgspec.json.encode(rates))


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])))
