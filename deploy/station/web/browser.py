# SPDX-License-Identifier: MIT
"""One browser: sends it pictures, events and replies, and checks what it sends: nothing of it is trusted."""

import asyncio
import contextlib
import math
from collections import deque
from typing import Final, NamedTuple

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web

from segway_ecc.deploy.station.views import Act, Command, Drive, ReplyView, Seen, SeenView
from segway_ecc.deploy.station.web.access import Role, Session
from segway_ecc.deploy.station.web.audit import AuditEntry
from segway_ecc.deploy.station.web.limits import Bucket
from segway_ecc.deploy.station.web.pictures import Picture, Pictures
from segway_ecc.deploy.station.web.shared import Cause, SharedServices

_MOST_WAITING: Final = 1000
_STUCK_NS: Final = 10_000_000_000
_MISTAKES: Final = frozenset(
    {Cause.MALFORMED, Cause.OVERSIZED, Cause.OUT_OF_RANGE, Cause.REPLAYED_COMMAND, Cause.MESSAGE_RATE}
)
_VIEWER: Final = "a viewer may only watch and stop"
MOST_BYTES: Final = 160 * 1024
"""Of a whole message: a sequence in JSON, where each line break takes two."""
MOST_SEQUENCE_BYTES: Final = 64 * 1024
_LONGEST_NAME: Final = 80
_LONGEST_ROBOT: Final = 256
_LARGEST_ID: Final = 2**53 - 1
"""A browser's numbers are exact up to here (ECMA-262, Number.MAX_SAFE_INTEGER)."""
_decoder: Final[msgspec.json.Decoder[Command | Drive | Seen]] = msgspec.json.Decoder(Command | Drive | Seen)


class Peer(NamedTuple):
    """The other end of a socket.

    Attributes:
        transport: Is aborted where it is stuck.
        inflates: Whether it takes pictures compressed, as binary messages.
    """

    address: str
    transport: asyncio.WriteTransport | None
    inflates: bool


class Browser:
    """Sends the newest picture as soon as those before have arrived, and all events and replies in their order."""

    def __init__(self, shared: SharedServices, socket: web.WebSocketResponse, session: Session, peer: Peer) -> None:
        """Serve a socket that is open, of a session."""
        self.session = session
        self.address = peer.address
        self._shared = shared
        self._socket = socket
        self._transport = peer.transport
        self._inflates = peer.inflates
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[bytes] = deque()
        self._pictures = Pictures()
        self._wake = asyncio.Event()
        self._sending_since_ns: int | None = None
        now_ns = shared.clock_ns()
        self._messages = Bucket(shared.limits.messages, now_ns)
        self._mistakes = Bucket(shared.limits.mistakes, now_ns)
        self._last_id = 0
        self._driven = ""
        self._ending: tuple[int, str] | None = None

    def show(self, picture: Picture) -> None:
        """Send a picture as soon as those before have arrived, in place of one that was not yet sent."""
        self._pictures.put(picture)
        self._wake.set()

    def queue(self, message: bytes) -> None:
        """Send an event or a reply; a browser that leaves too many waiting has to come back."""
        if len(self._waiting) >= _MOST_WAITING:
            self._end_for(Cause.TOO_SLOW, WSCloseCode.TRY_AGAIN_LATER, "too slow")
            return
        self._waiting.append(message)
        self._wake.set()

    def end(self, code: int, reason: str) -> None:
        """Close the socket with a code and a reason."""
        if self._ending is None:
            self._ending = (code, reason)
        self._wake.set()

    def is_stuck(self, now_ns: int) -> bool:
        """Whether a message was not sent, or a picture not seen, for so long that the browser counts as gone."""
        return any(
            since_ns is not None and now_ns - since_ns > _STUCK_NS
            for since_ns in (self._sending_since_ns, self._pictures.unseen_since_ns)
        )

    def abort(self, cause: Cause) -> None:
        """Abort the connection of a browser that is gone."""
        self._end_for(cause, WSCloseCode.GOING_AWAY, "gone")
        if self._transport is not None:
            self._transport.abort()

    async def send(self) -> None:
        """Send until the socket is to be closed, and close it."""
        with contextlib.suppress(ConnectionError):
            while self._ending is None:
                await self._wake.wait()
                self._wake.clear()
                while self._ending is None and (following := self._next()) is not None:
                    self._sending_since_ns = self._shared.clock_ns()
                    await self._socket.send_frame(*following)
                    self._sending_since_ns = None
            code, reason = self._ending
            await self._socket.close(code=code, message=reason.encode())

    def receive(self, message: str | bytes) -> None:
        """Check and carry out a message of the browser's; bytes are refused."""
        now_ns = self._shared.clock_ns()
        try:
            decoded = self._decode(message, now_ns)
            if isinstance(decoded, Seen):
                self._on_seen(decoded, now_ns)
                return
            self._check(decoded, now_ns)
        except RefusedMessageError as refusal:
            self._shared.refusals[refusal.cause] += 1
            self.queue(msgspec.json.encode(ReplyView(id=refusal.number, is_accepted=False, text=str(refusal))))
            if refusal.cause in _MISTAKES and not self._mistakes.take_token(now_ns):
                self.end(WSCloseCode.POLICY_VIOLATION, f"too many messages were refused, the last: {refusal.cause}")
            return
        if isinstance(decoded, Drive):
            self._drive(decoded)
        else:
            self._submit(decoded)

    def on_closed(self) -> None:
        """Bring to rest what it drove, as its socket is closed."""
        if self._driven:
            self._drive(Drive(id=self._last_id + 1, robot=self._driven, linear=0.0, angular=0.0))

    def _next(self) -> tuple[bytes, WSMsgType] | None:
        """What is sent next, and as what."""
        if self._waiting:
            return self._waiting.popleft(), WSMsgType.TEXT
        picture = self._pictures.take(self._shared.clock_ns())
        if picture is None:
            return None
        return (picture.deflated, WSMsgType.BINARY) if self._inflates else (picture.encoded, WSMsgType.TEXT)

    def _on_seen(self, seen: Seen, now_ns: int) -> None:
        """Make room for the next picture, and tell when this arrived; nothing where it says nothing new."""
        time_s = self._pictures.on_seen(seen.time_s, now_ns)
        if time_s is not None:
            self.queue(msgspec.json.encode(SeenView(time_s=time_s, at_s=now_ns * 1e-9)))

    def _decode(self, message: str | bytes, now_ns: int) -> Command | Drive | Seen:
        if isinstance(message, bytes):
            raise RefusedMessageError(Cause.MALFORMED, "a message is text")
        if not self._messages.take_token(now_ns):
            raise RefusedMessageError(Cause.MESSAGE_RATE, "too many messages")
        limits = self._shared.robots.limits
        return decode(message, limits.linear_velocity, limits.angular_velocity)

    def _check(self, message: Command | Drive, now_ns: int) -> None:
        if message.id <= self._last_id:
            text = f"the id must be more than {self._last_id}: an old message is not repeated"
            raise RefusedMessageError(Cause.REPLAYED_COMMAND, text, message.id)
        self._last_id = message.id
        session = self.session
        is_stop = isinstance(message, Command) and message.act is Act.STOP
        if session.role is not Role.OPERATOR and not is_stop:
            if session.commands.take_token(now_ns):  # so that a viewer cannot wash everything else out of the audit log
                self._note(message, "refused", _VIEWER)
            raise RefusedMessageError(Cause.VIEWER, _VIEWER, message.id)
        if isinstance(message, Drive):
            # Zero is what ends a movement: it is not what a limit is there for.
            if (message.linear or message.angular) and not session.drives.take_token(now_ns):
                raise RefusedMessageError(Cause.DRIVE_RATE, "too many set-points", message.id)
        elif not (session.stops if is_stop else session.commands).take_token(now_ns):
            self._note(message, "refused", "too many commands")
            raise RefusedMessageError(Cause.COMMAND_RATE, "too many commands; wait a moment", message.id)

    def _end_for(self, cause: Cause, code: int, reason: str) -> None:
        if self._ending is None:
            self._shared.refusals[cause] += 1
        self.end(code, reason)

    def _drive(self, drive: Drive) -> None:
        is_moving = bool(drive.linear or drive.angular)
        # Set-points come ten times a second: noted is where driving begins and where it ends.
        if is_moving and self._driven != drive.robot:
            self._note(drive, "asked", f"{drive.linear:g} m/s, {drive.angular:g} rad/s")
        elif not is_moving and self._driven == drive.robot:
            self._note(drive, "done")
        self._driven = drive.robot if is_moving else ""
        self._shared.robots.drive(self.session.who, drive)

    def _submit(self, command: Command) -> None:
        def reply(accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
            # It comes from another thread, and at times when the server has already ended.
            self._note(command, "accepted" if accepted else "failed", text)
            encoded = msgspec.json.encode(ReplyView(id=command.id, is_accepted=accepted, text=text))
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self.queue, encoded)

        self._note(command, "asked", command.name)
        self._shared.robots.submit(self.session.who, command, reply)

    def _note(self, message: Command | Drive, outcome: str, text: str = "") -> None:
        entry = AuditEntry(
            who=self.session.who,
            role=self.session.role,
            address=self.address,
            act=message.act.value if isinstance(message, Command) else ("rest" if outcome == "done" else "drive"),
            robot=message.robot,
            number=message.id,
            outcome=outcome,
            text=text,
        )
        self._shared.audit.add(entry)


class RefusedMessageError(Exception):
    """A message that is refused, with the cause and the reason."""

    def __init__(self, cause: Cause, text: str, number: int = 0) -> None:
        """Refuse a message; `number` is its id where it has one."""
        super().__init__(text)
        self.cause = cause
        self.number = number


def decode(message: str, max_linear: float, max_angular: float) -> Command | Drive | Seen:
    """A command, a set-point within the limits, m/s and rad/s, or the word that a picture was seen.

    Raises:
        RefusedMessageError: It is anything else.
    """
    try:
        content = message.encode()
        if len(content) > MOST_BYTES:
            raise RefusedMessageError(Cause.OVERSIZED, f"a message has at most {MOST_BYTES} bytes")
        decoded = _decoder.decode(content)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise RefusedMessageError(Cause.MALFORMED, f"not a message: {str(error)[:200]}") from None
    if isinstance(decoded, Seen):
        return decoded
    if not 0 < decoded.id <= _LARGEST_ID:
        raise RefusedMessageError(Cause.OUT_OF_RANGE, "an id counts up from 1")
    _check_text("a robot's namespace", decoded.robot, _LONGEST_ROBOT, decoded.id)
    if isinstance(decoded, Command):
        _check_text("a name", decoded.name, _LONGEST_NAME, decoded.id)
        if len(decoded.text.encode("utf-8", "surrogatepass")) > MOST_SEQUENCE_BYTES:
            text = f"a sequence has at most {MOST_SEQUENCE_BYTES} bytes"
            raise RefusedMessageError(Cause.OVERSIZED, text, decoded.id)
        return decoded
    for name, value, limit in (("linear", decoded.linear, max_linear), ("angular", decoded.angular, max_angular)):
        if not (math.isfinite(value) and abs(value) <= limit):
            raise RefusedMessageError(Cause.OUT_OF_RANGE, f"{name} is at most {limit:g} either way", decoded.id)
    return decoded


def _check_text(what: str, text: str, longest: int, number: int) -> None:
    if len(text) > longest or not text.isprintable():
        why = f"{what} has at most {longest} letters, all of them printable"
        raise RefusedMessageError(Cause.OUT_OF_RANGE, why, number)
