# SPDX-License-Identifier: MIT
"""Reading a log as far as it goes: also one that a power cut or a full disk has cut off anywhere."""

import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Footer, Message, Metadata
from mcap.stream_reader import StreamReader

from segway_ecc.node.errors import RecordingError

# What the library raises at bytes that are not what they should be; LZ4 raises RuntimeError.
_DAMAGE = (McapError, EOFError, struct.error, ValueError, RuntimeError, KeyError, IndexError, AttributeError)


class Salvage:
    """What one file holds, read from its beginning.

    Attributes:
        path: The file.
        is_whole: Whether the file was read to its proper end.
        attachments: Those met so far, by name.
        metadata: Those met so far, by name.
    """

    def __init__(self, path: Path) -> None:
        """Read nothing yet."""
        self.path = path
        self.is_whole = False
        self.attachments: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}

    def messages(self) -> Iterator[tuple[str, Message]]:
        """The messages, each with its topic, up to where the file is cut off or damaged.

        Raises:
            RecordingError: The file cannot be opened.
        """
        try:
            stream = self.path.open("rb")
        except OSError as error:
            raise RecordingError(f"cannot read the log {self.path}: {error.strerror}") from error
        channels: dict[int, str] = {}
        with stream:
            records = iter(StreamReader(stream, validate_crcs=True).records)
            while True:
                try:
                    record = next(records, None)
                except _DAMAGE:
                    return
                match record:
                    case None:
                        return
                    case Attachment(name=name, data=data):
                        self.attachments[name] = data
                    case Metadata(name=name, metadata=values):
                        self.metadata[name] = values
                    case Channel(id=number, topic=topic):
                        channels[number] = topic
                    case Message() if record.channel_id in channels:
                        yield channels[record.channel_id], record
                    case Footer():
                        self.is_whole = True
