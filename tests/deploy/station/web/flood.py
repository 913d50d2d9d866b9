# SPDX-License-Identifier: MIT
"""Sends requests: `python flood.py PORT REQUESTS_PER_S SECONDS ADDRESS`; prints requests, connections and seconds."""

import contextlib
import socket
import sys
import time

REQUESTS_AT_ONCE = 25
OPEN_AT_ONCE = 16


def main(port: int, per_s: float, seconds: float, address: str) -> None:
    request = f"GET /logs HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode() * REQUESTS_AT_ONCE
    begun_s, sent, connections, open_sockets = time.monotonic(), 0, 0, []
    while (passed_s := time.monotonic() - begun_s) < seconds:
        if sent > per_s * passed_s:
            time.sleep(0.001)
            continue
        each = socket.socket()
        open_sockets.append(each)
        each.settimeout(0.2)
        connections += 1
        # Refused at the door: that is what this is for.
        with contextlib.suppress(OSError):
            each.bind((address, 0))
            each.connect(("127.0.0.1", port))
            each.send(request)
        sent += REQUESTS_AT_ONCE
        if len(open_sockets) > OPEN_AT_ONCE:
            open_sockets.pop(0).close()
    sys.stdout.write(f"{sent} {connections} {time.monotonic() - begun_s}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
