# SPDX-License-Identifier: MIT
"""A report as a web page of its own, which loads nothing from elsewhere."""

import importlib.resources
from collections.abc import Iterable, Mapping
from html import escape
from typing import Final

_ONE_LINE: Final = 40
"""Characters of a cell; a longer text is broken."""


def page(title: str, introduction: str, sections: Iterable[str]) -> str:
    """A complete HTML page, with its style sheet in it; its sections are HTML, see `section`."""
    css = importlib.resources.files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        f"<h1>{escape(title)}</h1>\n<p>{escape(introduction)}</p>\n{''.join(sections)}</main>\n</body>\n</html>\n"
    )


def section(title: str, content: str) -> str:
    """A section of a page; its content is HTML."""
    return f"<section>\n<h2>{escape(title)}</h2>\n{content}</section>\n"


def wide(label: str, content: str) -> str:
    """Content, as HTML, that scrolls by itself where the screen is narrow; the label is for screen readers."""
    return f'<div class="wide" role="region" aria-label="{escape(label)}" tabindex="0">\n{content}</div>\n'


def pairs(texts: Mapping[str, str]) -> str:
    """Names and texts as an HTML list, one pair a line."""
    items = "".join(f"<dt>{escape(name)}</dt>\n<dd>{escape(text)}</dd>\n" for name, text in texts.items())
    return f"<dl>\n{items}</dl>\n"


def figure(caption: str, content: str) -> str:
    """A figure, as HTML, with its caption below."""
    return f"<figure>\n{wide(caption, content)}<figcaption>{escape(caption)}</figcaption>\n</figure>\n"


def table(label: str, head: Iterable[str], rows: Iterable[str]) -> str:
    """A table that scrolls by itself; `rows` are HTML, see `table_row`."""
    names = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    return wide(label, f"<table>\n<thead>\n<tr>{names}</tr>\n</thead>\n<tbody>\n{''.join(rows)}</tbody>\n</table>\n")


def table_row(cells: Iterable[str]) -> str:
    """A row of plain cells, as HTML; one that holds sentences is read as such, in lines."""
    return f"<tr>{''.join(map(_cell, cells))}</tr>\n"


def _cell(text: str) -> str:
    prose = ' class="prose"' if len(text) > _ONE_LINE else ""
    return f"<td{prose}>{escape(text)}</td>"
