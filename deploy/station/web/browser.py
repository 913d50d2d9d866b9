"""One browser: what it is sent, and what it may ask."""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web

from segway_ecc.deploy.station.connection import Reply
from segway_ecc.deploy.station.views import Act, Command, Drive, ReplyView
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.audit import AuditEntry, AuditLog
from segway_ecc.deploy.station.web.interfaces import Robots
from segway_ecc.deploy.station.web.limits import Bucket, Limits
from segway_ecc.deploy.station.web.messages import RefusedMessageError, decode
from segway_ecc.deploy.station.web.refusals import Cause, Refusals
from segway_ecc.deploy.station.web.sessions import Session

_MOST_WAITING: Final = 1000
_STUCK_NS: Final = 10_000_000_000
_MISTAKES: Final = frozenset(
    {Cause.MALFORMED, Cause.OVERSIZED, Cause.OUT_OF_RANGE, Cause.REPLAYED_COMMAND, Cause.MESSAGE_RATE}
)
_VIEWER: Final = "a viewer may only look"


class SharedServices(NamedTuple):
    """What all browsers share."""

    robots: Robots
    audit: AuditLog
    refusals: Refusals
    limits: Limits
    clock_ns: Callable[[], int]


class Visit(NamedTuple):
    """Whose socket it is.

    Attributes:
        session: Whose.
        address: From where.
        transport: The connection, to be cut.
    """

    session: Session
    address: str
    transport: asyncio.WriteTransport | None


class Browser:
    """Sends the newest picture, never an old one, and all events and replies in their order."""

    def __init__(self, desk: SharedServices, visit: Visit, socket: web.WebSocketResponse, now_ns: int) -> None:
        """Serve a socket that is open."""
        self.session = visit.session
        self.address = visit.address
        self._desk = desk
        self._socket = socket
        self._transport = visit.transport
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[bytes] = deque()
        self._picture: bytes | None = None
        self._wake = asyncio.Event()
        self._sending_since_ns: int | None = None
        self._messages = Bucket(desk.limits.messages, now_ns)
        self._mistakes = Bucket(desk.limits.mistakes, now_ns)
        self._last_id = 0
        self._driven = ""
        self._ending: tuple[int, str] | None = None

    def show(self, picture: bytes) -> None:
        """Send a picture; one that was not yet sent is forgotten."""
        self._picture = picture
        self._wake.set()

    def tell(self, message: bytes) -> None:
        """Send an event or a reply; a browser that leaves too many waiting is told to come back."""
        if len(self._waiting) >= _MOST_WAITING:
            self._refuse_all(Cause.TOO_SLOW, WSCloseCode.TRY_AGAIN_LATER, "too slow")
            return
        self._waiting.append(message)
        self._wake.set()

    def end(self, code: int, reason: str) -> None:
        """Close the socket, and say why."""
        if self._ending is None:
            self._ending = (code, reason)
        self._wake.set()

    def is_stuck(self, now_ns: int) -> bool:
        """Whether a message could not be sent for so long that nobody is taken to be there."""
        return self._sending_since_ns is not None and now_ns - self._sending_since_ns > _STUCK_NS

    def drop(self, cause: Cause) -> None:
        """Cut the connection: nobody is there to be told."""
        self._refuse_all(cause, WSCloseCode.GOING_AWAY, "gone")
        if self._transport is not None:
            self._transport.abort()

    async def send(self) -> None:
        """Send until the socket is to be closed, and close it."""
        with contextlib.suppress(ConnectionError):
            while self._ending is None:
                await self._wake.wait()
                self._wake.clear()
                await self._send_waiting()
            code, reason = self._ending
            await self._socket.close(code=code, message=reason.encode())

    async def _send_waiting(self) -> None:
        while self._ending is None and (self._waiting or self._picture is not None):
            if self._waiting:
                message = self._waiting.popleft()
            else:
                message, self._picture = self._picture or b"", None
            self._sending_since_ns = self._desk.clock_ns()
            await self._socket.send_frame(message, WSMsgType.TEXT)
            self._sending_since_ns = None

    def take(self, message: str, now_ns: int) -> None:
        """A message of the browser's."""
        if not self._messages.take(now_ns):
            self._refuse(RefusedMessageError(Cause.MESSAGE_RATE, "too many messages"), now_ns)
            return
        limits = self._desk.robots.limits
        try:
            decoded = decode(message, limits.linear_velocity, limits.angular_velocity)
            self._check(decoded, now_ns)
        except RefusedMessageError as refusal:
            self._refuse(refusal, now_ns)
            return
        if isinstance(decoded, Drive):
            self._drive(decoded)
        else:
            self._submit(decoded)

    def take_bytes(self, now_ns: int) -> None:
        """A message that is not even text."""
        self._refuse(RefusedMessageError(Cause.MALFORMED, "a message is text"), now_ns)

    def gone(self) -> None:
        """The socket is closed: what it drove is told to rest."""
        if self._driven:
            self._drive(Drive(id=self._last_id + 1, robot=self._driven, linear=0.0, angular=0.0))

    def _check(self, message: Command | Drive, now_ns: int) -> None:
        if message.id <= self._last_id:
            text = f"the id must be more than {self._last_id}: an old message is not repeated"
            raise RefusedMessageError(Cause.REPLAYED_COMMAND, text, message.id)
        self._last_id = message.id
        session = self.session
        if session.role is not Role.OPERATOR:
            if session.commands.take(now_ns):  # so that a viewer cannot wash everything else out of the audit log
                self._note(message, "refused", _VIEWER)
            raise RefusedMessageError(Cause.VIEWER, _VIEWER, message.id)
        if isinstance(message, Drive):
            # Zero is what ends a movement: it is not what a limit is there for.
            if (message.linear or message.angular) and not session.drives.take(now_ns):
                raise RefusedMessageError(Cause.DRIVE_RATE, "too many set-points", message.id)
        elif not (session.stops if message.act is Act.STOP else session.commands).take(now_ns):
            self._note(message, "refused", "too many commands")
            raise RefusedMessageError(Cause.COMMAND_RATE, "too many commands; wait a moment", message.id)

    def _refuse(self, refusal: RefusedMessageError, now_ns: int) -> None:
        self._desk.refusals.add(refusal.cause)
        self.tell(msgspec.json.encode(ReplyView(id=refusal.number, is_accepted=False, text=str(refusal))))
        if refusal.cause in _MISTAKES and not self._mistakes.take(now_ns):
            self.end(WSCloseCode.POLICY_VIOLATION, f"too many messages were refused, the last: {refusal.cause}")

    def _refuse_all(self, cause: Cause, code: int, reason: str) -> None:
        if self._ending is None:
            self._desk.refusals.add(cause)
        self.end(code, reason)

    def _drive(self, drive: Drive) -> None:
        is_moving = bool(drive.linear or drive.angular)
        # Set-points come ten times a second: noted is where driving begins and where it ends.
        if is_moving and self._driven != drive.robot:
            self._note(drive, "asked", f"{drive.linear:g} m/s, {drive.angular:g} rad/s")
        elif not is_moving and self._driven == drive.robot:
            self._note(drive, "done")
        self._driven = drive.robot if is_moving else ""
        self._desk.robots.drive(self.session.who, drive)

    def _submit(self, command: Command) -> None:
        self._note(command, "asked", command.name)
        self._desk.robots.submit(self.session.who, command, self._reply_to(command))

    def _reply_to(self, command: Command) -> Reply:
        def reply(accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
            # It comes from another thread, and at times when the server has already ended.
            self._note(command, "accepted" if accepted else "failed", text)
            encoded = msgspec.json.encode(ReplyView(id=command.id, is_accepted=accepted, text=text))
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self.tell, encoded)

        return reply

    def _note(self, message: Command | Drive, outcome: str, text: str = "") -> None:
        act = message.act.value if isinstance(message, Command) else ("rest" if outcome == "done" else "drive")
        session = self.session
        self._desk.audit.add(
            AuditEntry(
                who=session.who,
                role=session.role,
                address=self.address,
                act=act,
                robot=message.robot,
                number=message.id,
                outcome=outcome,
                text=text,
            )
        )
