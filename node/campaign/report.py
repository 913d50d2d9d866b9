"""A campaign as a web page of its own, which loads nothing from elsewhere."""

import html
import importlib.resources
from collections.abc import Mapping, Sequence
from typing import Final

from node.campaign.result import Result
from node.campaign.table import HEAD, cells, verdict

_TITLE: Final = "Campaign: declared faults, in lock step"
_INTRODUCTION: Final = (
    "Each row is one run of node, bus, drives and plant on a simulated clock. Times count from the fault: to the "
    "change of mode or line, and to the last torque or voltage that a drive gave. The distance is from where the "
    "robot without the fault is at the same time. The command in a row runs it again, to the same bits."
)


def render(results: Sequence[Result], facts: Mapping[str, str]) -> str:
    """Render the results of a campaign, those that are not as declared first.

    Args:
        results: What came of each run.
        facts: What else is known of the campaign, by name.

    Returns:
        A complete HTML page.
    """
    css = importlib.resources.files(__package__).joinpath("report.css").read_text(encoding="utf-8")
    bad = [result for result in results if not result.is_as_declared]
    good = [result for result in results if result.is_as_declared]
    sections = (
        _section("Verdict", f"<p>{_text(verdict(results))}.</p>\n"),
        _section("Not as declared", _table(bad)) if bad else "",
        _section("As declared", _table(good)) if good else "",
        _section("Facts of this campaign", _facts(facts)),
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_text(_TITLE)}</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        f"<h1>{_text(_TITLE)}</h1>\n<p>{_text(_INTRODUCTION)}</p>\n{''.join(sections)}</main>\n</body>\n</html>\n"
    )


def _text(text: str) -> str:
    return html.escape(text)


def _section(title: str, content: str) -> str:
    return f"<section>\n<h2>{_text(title)}</h2>\n{content}</section>\n"


def _table(results: Sequence[Result]) -> str:
    names = "".join(f'<th scope="col">{_text(name)}</th>' for name in (*HEAD, "reason, and how to run it again"))
    rows = "".join(_row(result) for result in results)
    return (
        '<div class="wide" role="region" aria-label="Runs" tabindex="0">\n<table>\n'
        f"<thead>\n<tr>{names}</tr>\n</thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n"
    )


def _row(result: Result) -> str:
    name, *others = cells(result)
    data = "".join(f"<td>{_text(text)}</td>" for text in others)
    parts = (*result.why_not, result.reason)
    said = "".join(f"<span>{_text(part)}</span><br>" for part in parts if part)
    last = f"<td>{said}<code>{_text(result.command)}</code></td>"
    kind = "" if result.is_as_declared else ' class="bad"'
    return f'<tr{kind}><th scope="row">{_text(name)}</th>{data}{last}</tr>\n'


def _facts(facts: Mapping[str, str]) -> str:
    items = "".join(f"<dt>{_text(name)}</dt>\n<dd>{_text(value)}</dd>\n" for name, value in facts.items())
    return f"<dl>\n{items}</dl>\n"
