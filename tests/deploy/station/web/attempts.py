# SPDX-License-Identifier: MIT
"""Requests that do not belong, one by one."""

from collections.abc import Mapping
from typing import NamedTuple

from segway_ecc.deploy.station.web.access import Role


class Attempt(NamedTuple):
    """A request, and what it is to come to."""

    what: str
    method: str
    path: str
    headers: Mapping[str, str]
    status: int
    cause: str
    body: str | None = None
    role: Role | None = None


JSON = {"Content-Type": "application/json"}

EVIL = {"Origin": "http://evil.example"}

LOGIN = '{"name": "eve", "token": "x"}'

CROSS = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}

UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}

NOBODY = UPGRADE | {"Origin": ""}

VIEWER, OPERATOR = Role.VIEWER, Role.OPERATOR

ATTEMPTS = [
    Attempt("the socket with no token", "GET", "/socket", UPGRADE, 401, "no session"),
    Attempt("the logs with no token", "GET", "/logs", {}, 401, "no session"),
    Attempt("a log with no token", "GET", "/logs/a.mcap", {}, 401, "no session"),
    Attempt("a support bundle with no token", "GET", "/robots/%2Falice/bundle", {}, 401, "no session"),
    Attempt("the last ten minutes with no token", "GET", "/robots/%2Falice/trace", {}, 401, "no session"),
    Attempt("the counters with no token", "GET", "/refused", {}, 401, "no session"),
    Attempt("the socket with an invented session", "GET", "/socket", UPGRADE | {"Cookie": "S=x"}, 401, "no session"),
    Attempt("log-in with a wrong token", "POST", "/login", JSON, 403, "wrong token", LOGIN),
    Attempt("log-in with no token", "POST", "/login", JSON, 403, "wrong token", '{"name": "eve", "token": ""}'),
    Attempt("log-in from a foreign origin", "POST", "/login", JSON | EVIL, 403, "foreign origin", LOGIN),
    Attempt("log-out from a foreign origin", "POST", "/logout", JSON | EVIL, 403, "foreign origin", "{}", OPERATOR),
    Attempt(
        "the socket from a foreign origin", "GET", "/socket", UPGRADE | EVIL, 403, "foreign origin", None, OPERATOR
    ),
    Attempt(
        "the socket from a page that has no origin (a frame in a sandbox, a file)",
        "GET",
        "/socket",
        UPGRADE | {"Origin": "null"},
        403,
        "foreign origin",
        None,
        OPERATOR,
    ),
    Attempt("the socket with a session and no origin", "GET", "/socket", NOBODY, 403, "foreign origin", None, OPERATOR),
    Attempt("a log as an image in a foreign page", "GET", "/logs/a.mcap", CROSS, 403, "foreign origin", None, OPERATOR),
    Attempt("a foreign host, as by DNS rebinding", "GET", "/", {"Host": "evil.example"}, 421, "foreign host"),
    Attempt(
        "a foreign host and its own origin, as by DNS rebinding",
        "POST",
        "/login",
        JSON | EVIL | {"Host": "evil.example"},
        421,
        "foreign host",
        LOGIN,
    ),
    Attempt(
        "log-in by a foreign form, which cannot send JSON",
        "POST",
        "/login",
        {"Content-Type": "text/plain"},
        400,
        "bad request",
        LOGIN,
    ),
    Attempt(
        "log-out by a form, which cannot send JSON",
        "POST",
        "/logout",
        {"Content-Type": "text/plain"},
        400,
        "bad request",
        "{}",
        OPERATOR,
    ),
    Attempt("log-in that is no JSON", "POST", "/login", JSON, 400, "bad request", "{"),
    Attempt("log-in with an unknown field", "POST", "/login", JSON, 400, "bad request", '{"role": "operator"}'),
    Attempt("log-in with a number for a token", "POST", "/login", JSON, 400, "bad request", '{"token": 1}'),
    Attempt("log-in nested 2,000 deep", "POST", "/login", JSON, 400, "bad request", '{"name":' + "[" * 2000),
    Attempt("log-in of a megabyte", "POST", "/login", JSON, 413, "oversized", "x" * 1_000_000),
    Attempt("the socket without an upgrade", "GET", "/socket", {}, 400, "bad request", None, OPERATOR),
    Attempt("a method that is not there", "DELETE", "/logs", {}, 400, "bad request", None, OPERATOR),
    Attempt("a path that is not there", "GET", "/admin", {}, 404, "not found"),
    Attempt("a support bundle as a viewer", "GET", "/robots/%2Falice/bundle", {}, 403, "viewer", None, VIEWER),
    Attempt("the counters as a viewer", "GET", "/refused", {}, 403, "viewer", None, VIEWER),
    *(
        Attempt(f"out of the page by {path}", "GET", path, {}, 404, "not found")
        for path in (
            "/static/../station.py",
            "/static/..%2Fstation.py",
            "/static/%2e%2e/%2e%2e/config.py",
            "/static//etc/passwd",
            "/static/..%5cstation.py",
            "/static/%00",
        )
    ),
    *(
        Attempt(f"out of the logs by {path}", "GET", path, {}, 404, "not found", None, OPERATOR)
        for path in (
            "/logs/..%2Faccess.json",
            "/logs/%2e%2e%2faccess.json",
            "/logs/..",
            "/logs/%2Fetc%2Fpasswd",
            "/logs/.hidden",
            "/logs/link",
            "/logs/folder",
            "/logs/folder%2Finner",
            "/logs/pipe",
            "/logs/a%00",
        )
    ),
]
