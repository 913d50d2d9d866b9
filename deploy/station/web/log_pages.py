# SPDX-License-Identifier: MIT
"""Logs as a page; every text in it may be a stranger's."""

import datetime as dt
import html
import urllib.parse
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.deploy.station.archive_client import Progress
from segway_ecc.deploy.support.archive_files import LogFile

_NS: Final = 1e-9
_LATEST_S: Final = 253_402_300_799  # the end of the year 9999
_REFRESH: Final = '<meta http-equiv="refresh" content="2">'
_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Recorded logs</title><link rel="icon" href="/static/icon.svg" type="image/svg+xml">{}
<link rel="stylesheet" href="/static/theme.css"><link rel="stylesheet" href="/static/style.css">
</head><body><main><h1>Recorded logs</h1>
<p><a href="/">Base station</a> <a href="/logs">All logs</a></p>{}</main></body></html>
"""
_SECTION: Final = "<section><h2>{}</h2>{}</section>"
_TABLE: Final = """<table>
<thead><tr><th scope="col">Log</th><th scope="col">Bytes</th><th scope="col">Written, UTC</th>{}</tr></thead>
<tbody>{}</tbody></table>"""
_ROW: Final = '<tr><th scope="row">{}</th><td>{}</td><td>{}</td>{}</tr>'
_LINK: Final = '<a href="{}" download>{}</a>'
_BUTTON: Final = '<form method="post" action="{}"><button aria-label="{} {}">{}</button></form>'
_BAR: Final = '<progress aria-label="{}" value="{}" max="{}"></progress> {:.0f} %'


class RobotLogs(NamedTuple):
    """The logs of a robot.

    Attributes:
        error: Why it offers nothing.
        progress: Of what is fetched, by name.
        here: The logs that lie in the station's folder whole, by name: when each was written, ns since the Unix epoch.
    """

    robot: str
    logs: Sequence[LogFile] = ()
    error: str = ""
    progress: Mapping[str, Progress] = {}
    here: Mapping[str, LogFile] = {}

    def as_json(self) -> dict[str, object]:
        """As it is sent."""
        logs = []
        for log in self.logs:
            progress = self.progress.get(log.name)
            state, fetched, why = "done" if log == self.here.get(log.name) else "on the robot", 0, ""
            if progress is not None and progress.state != "done":
                state, fetched, why = progress.state, progress.fetched, progress.why
            logs.append({**log._asdict(), "state": state, "fetched": fetched, "why": why})
        return {"robot": self.robot, "logs": logs, "error": self.error}


def path_of(robot: str, name: str = "") -> str:
    """Where the logs of a robot are, or one of them."""
    path = f"/robots/{urllib.parse.quote(robot, safe='')}/logs"
    return f"{path}/{urllib.parse.quote(name, safe='')}" if name else path


def logs_page(logs: Sequence[LogFile] | None, robots: Sequence[RobotLogs], *, may_fetch: bool) -> str:
    """The page: the station's own logs, where they are given, and those of robots."""
    sections = []
    if logs is not None:
        own = [(log, _LINK.format(f"/logs/{urllib.parse.quote(log.name, safe='')}", _text(log)), "") for log in logs]
        sections.append(_SECTION.format("On this station", _table(own, "")))
    for robot in robots:
        rows = []
        for log in robot.logs:
            is_here = log.name in robot.here
            name = _LINK.format(path_of(robot.robot, log.name), _text(log)) if is_here else _text(log)
            rows.append((log, name, f"<td>{_act(robot, log, may_fetch)}</td>"))
        table = f"<p>{html.escape(robot.error)}</p>" if robot.error else _table(rows, '<th scope="col">Fetch</th>')
        sections.append(_SECTION.format(f"On robot {html.escape(robot.robot)}", table))
    is_going_on = any(progress.is_going_on for each in robots for progress in each.progress.values())
    return _PAGE.format(_REFRESH if is_going_on else "", "".join(sections))


def _table(rows: Sequence[tuple[LogFile, str, str]], more: str) -> str:
    """Rows of a log, its name as HTML and further cells; `more` heads these."""
    if not rows:
        return "<p>There are none.</p>"
    text = ""
    for log, name, cells in rows:
        written = dt.datetime.fromtimestamp(min(log.changed_ns * _NS, _LATEST_S), dt.UTC).strftime("%Y-%m-%d %H:%M:%S")
        text += _ROW.format(name, log.size, written, cells)
    return _TABLE.format(more, text)


def _act(robot: RobotLogs, log: LogFile, may_fetch: bool) -> str:  # noqa: FBT001 - passed through
    progress = robot.progress.get(log.name)
    if progress is not None and progress.is_going_on:
        share = 100.0 * progress.fetched / max(progress.size, 1)
        return _BAR.format(_text(log), progress.fetched, max(progress.size, 1), share)
    if log == robot.here.get(log.name):
        return "here"
    failed = progress is not None and progress.state == "failed"
    word = "Try again" if failed else "Fetch anew" if log.name in robot.here else "Fetch"
    button = _BUTTON.format(path_of(robot.robot, log.name), word, _text(log), word) if may_fetch else ""
    return f"{html.escape(progress.why)} {button}" if failed and progress is not None else button


def _text(log: LogFile) -> str:
    return html.escape(log.name)
