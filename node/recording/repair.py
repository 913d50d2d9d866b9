# SPDX-License-Identifier: MIT
"""A whole log of what is left of one: with summary and index, for every tool that reads MCAP."""

from pathlib import Path

from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cycle_log import COPIES
from segway_ecc.node.recording.mcap_log import REPAIR, McapLog
from segway_ecc.node.recording.salvage import Salvage


def repair_log(source: Salvage, out: Path) -> int:
    """Write all that is whole in a log to another file, with what is not as metadata; returns how many messages.

    Raises:
        RecordingError: Nothing is left of it, or `out` is there already or cannot be written.
    """
    if not source.topics:
        raise RecordingError(f"{source.path} cannot be repaired: there is no message in it")
    if out.exists():
        raise RecordingError(f"{out} is there already; choose another with --out")
    count = 0
    with McapLog(out) as log:
        for name, values in source.metadata.items():
            log.metadata(name, values)
        for name, data in source.attachments.items():
            log.attach(name, "text/plain", data, COPIES)
        for topic, message in source.messages():
            type_name, definition = source.topics[topic]
            log.add(topic, type_name, message.log_time, message.data, definition)
            count += 1
        lacks = {f"damage {number}": text for number, text in enumerate(source.damage)}
        log.metadata(REPAIR, {"is_cut": str(source.is_cut).lower(), **lacks})
    return count
