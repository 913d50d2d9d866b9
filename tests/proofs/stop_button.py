# SPDX-License-Identifier: MIT
"""Nothing but a stop: `python stop_button.py URL ROBOT` presses it for each line on standard input, and prints when.

A process of its own, since playwright has the test's event loop. Prints `[sent, answered]`, monotonic ns.
"""

import asyncio
import json
import sys
import time

import aiohttp


async def heard(socket: aiohttp.ClientWebSocketResponse) -> aiohttp.WSMessage:
    """The next message; the station sends no picture before it knows that the one before has arrived."""
    message = await socket.receive()
    if message.type is aiohttp.WSMsgType.TEXT:
        content = json.loads(message.data)
        if content["kind"] == "fleet":
            await socket.send_json({"kind": "seen", "time_s": content["time_s"]})
    return message


async def main(url: str, robot: str) -> None:
    loop = asyncio.get_running_loop()
    async with aiohttp.ClientSession(url, headers={"Origin": url}) as client:
        async with client.get("/session"):
            pass
        async with client.ws_connect("/socket", max_msg_size=0) as socket:
            number = 0
            lines: asyncio.Queue[str] = asyncio.Queue()
            loop.add_reader(sys.stdin.fileno(), lambda: lines.put_nowait(sys.stdin.readline()))
            sys.stdout.write("ready\n")
            sys.stdout.flush()
            listening = asyncio.create_task(heard(socket))
            while True:
                pressing = asyncio.create_task(lines.get())
                while not pressing.done():  # pictures are read and forgotten
                    await asyncio.wait({pressing, listening}, return_when=asyncio.FIRST_COMPLETED)
                    if listening.done():
                        listening = asyncio.create_task(heard(socket))
                if not pressing.result():
                    listening.cancel()
                    return
                number += 1
                sent_ns = time.monotonic_ns()
                await socket.send_json({"kind": "command", "id": number, "robot": robot, "act": "stop"})
                while True:
                    message = await listening
                    listening = asyncio.create_task(heard(socket))
                    if message.type is not aiohttp.WSMsgType.TEXT:
                        return
                    reply = json.loads(message.data)
                    if reply["kind"] == "reply" and reply["id"] == number:
                        break
                if not reply["is_accepted"]:
                    sys.stderr.write(reply["text"])
                    return
                sys.stdout.write(json.dumps([sent_ns, time.monotonic_ns()]) + "\n")
                sys.stdout.flush()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], sys.argv[2]))
