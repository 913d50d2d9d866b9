# SPDX-License-Identifier: MIT
"""Checks every request before anything is done for it, and begins and ends sessions."""

import asyncio
import ipaddress
from typing import Final

import msgspec
from aiohttp import web

from segway_ecc.deploy.station.web.access import LONGEST_S, Access, Role, Session, Sessions
from segway_ecc.deploy.station.web.audit import AuditEntry
from segway_ecc.deploy.station.web.limits import Bucket, Buckets, site_of
from segway_ecc.deploy.station.web.shared import Cause, RefusedRequestError, SharedServices
from segway_ecc.deploy.station.web.site_address import SiteAddress

_BODY_S: Final = 5.0


class _Login(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str = ""
    token: str = ""


class AuthenticationMiddleware:
    """Checks requests by address, host, origin and session."""

    def __init__(self, place: SiteAddress, access: Access | None, shared: SharedServices) -> None:
        """Guard the station at `place`; without `access` everybody who reaches it is an operator."""
        _, self._audit, _, limits, self._clock_ns = shared
        self.sessions = Sessions(limits)
        self._place = place
        self._is_secure = place.scheme == "https"
        self._access = access
        # Browsers distinguish cookies by the machine and not by the port.
        self._cookie = f"station_{place.port}"
        self._requests = Buckets(limits.requests)
        self._logins = Buckets(limits.logins)
        self._all_logins = Bucket(limits.all_logins, shared.clock_ns())

    def check(self, request: web.Request) -> None:
        """Check the rate, host and origin of a request.

        Raises:
            RefusedRequestError: One of them is not allowed.
        """
        now_ns = self._clock_ns()
        if not self._requests.of(site_of(address_of(request)), now_ns).take_token(now_ns):
            raise RefusedRequestError(Cause.REQUEST_RATE)
        if len(request.headers.getall("Host", [])) != 1 or not self._place.is_ours(request.headers.get("Host")):
            raise RefusedRequestError(Cause.FOREIGN_HOST)
        opens_socket = request.path == "/socket" or "Upgrade" in request.headers
        if not self._place.may_request(request.method, request.headers, opens_socket=opens_socket):
            raise RefusedRequestError(Cause.FOREIGN_ORIGIN)

    def session(self, request: web.Request, role: Role = Role.VIEWER) -> Session:
        """The session of a request.

        Raises:
            RefusedRequestError: There is none, or its role does not suffice.
        """
        session = self.sessions.find(request.cookies.get(self._cookie, ""), self._clock_ns())
        if session is None:
            raise RefusedRequestError(Cause.NO_SESSION)
        if role is Role.OPERATOR and session.role is not Role.OPERATOR:
            raise RefusedRequestError(Cause.VIEWER)
        return session

    def session_or_new(self, request: web.Request, response: web.StreamResponse) -> Session | None:
        """The session of a request; where no token is needed, one is begun."""
        try:
            return self.session(request)
        except RefusedRequestError:
            if self._access is not None:
                return None
            return self._begin(request, response, "", Role.OPERATOR)

    def note(
        self, request: web.Request, act: str, session: Session | None, outcome: str = "done", text: str = ""
    ) -> None:
        """Note a request in the audit log; without another text that is the name of the file requested, if any."""
        names = request.match_info
        entry = AuditEntry(
            who="" if session is None else session.who,
            role="" if session is None else session.role.value,
            address=address_of(request),
            act=act,
            robot=names.get("robot", "")[:256],
            outcome=outcome,
            text=text or names.get("name", ""),
        )
        self._audit.add(entry)

    async def login(self, request: web.Request) -> web.Response:
        """Begin a session with a name and a token."""
        _require_json(request)
        try:
            given = msgspec.json.decode(await _body(request), type=_Login)
        except (msgspec.DecodeError, UnicodeError, RecursionError):
            raise RefusedRequestError(Cause.BAD_REQUEST) from None
        role = Role.OPERATOR if self._access is None else self._role(request, self._access, given.token)
        response = web.Response(status=204)
        self._leave(request)
        self._begin(request, response, given.name, role)
        return response

    async def logout(self, request: web.Request) -> web.Response:
        """End a session; the response does not show whether there was one."""
        _require_json(request)
        await _body(request)
        self._leave(request)
        response = web.Response(status=204)
        response.del_cookie(self._cookie, path="/", httponly=True, samesite="Strict", secure=self._is_secure)
        return response

    def _role(self, request: web.Request, access: Access, token: str) -> Role:
        now_ns = self._clock_ns()
        each = self._logins.of(site_of(address_of(request)), now_ns)
        # Only what fails is counted, so that a whole workshop can log in behind one address.
        if not each.has_token(now_ns) or not self._all_logins.has_token(now_ns):
            raise RefusedRequestError(Cause.LOGIN_RATE)
        role = access.role(token)
        if role is None:
            each.take_token(now_ns)
            self._all_logins.take_token(now_ns)
            self.note(request, "login", None, "refused", "the token is wrong")
            raise RefusedRequestError(Cause.WRONG_TOKEN)
        return role

    def _begin(self, request: web.Request, response: web.StreamResponse, name: str, role: Role) -> Session:
        secret, session = self.sessions.begin(name, role, self._clock_ns())
        response.set_cookie(
            self._cookie,
            secret,
            path="/",
            max_age=LONGEST_S,
            httponly=True,
            samesite="Strict",
            secure=self._is_secure,
        )
        self.note(request, "login", session)
        return session

    def _leave(self, request: web.Request) -> None:
        try:
            session = self.session(request)
        except RefusedRequestError:
            return
        self.sessions.end(session)
        self.note(request, "logout", session)


def _require_json(request: web.Request) -> None:
    """Another site's form cannot send this type without a preflight request, which is never answered here."""
    if request.content_type != "application/json":
        raise RefusedRequestError(Cause.BAD_REQUEST)


async def _body(request: web.Request) -> bytes:
    try:
        async with asyncio.timeout(_BODY_S):
            return await request.read()
    except TimeoutError:
        raise RefusedRequestError(Cause.BAD_REQUEST) from None


def address_of(request: web.Request) -> str:
    """The address that a request came from; there is no proxy in between, so no header is believed about that."""
    address = request.remote or ""
    try:
        return str(ipaddress.ip_address(address))
    except ValueError:
        return "unknown"
