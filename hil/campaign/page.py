# SPDX-License-Identifier: MIT
"""The results of a campaign as a web page."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from segway_ecc.hil.campaign.scenario import HEAD, ScenarioResult, cells, verdict
from segway_ecc.hil.page import page, pairs, section, table

_TITLE: Final = "Campaign: declared faults, in lock step"
_INTRODUCTION: Final = (
    "Each is one run of node, bus, drives and plant on a simulated clock. Times count from the fault: to the "
    "change of mode or line, and to the last torque or voltage that a drive gave. The distance is from where the "
    "robot without the fault is at the same time. The command below each runs it again, bit-identical."
)


def render(results: Sequence[ScenarioResult], facts: Mapping[str, str]) -> str:
    """The results and named facts of a campaign as a complete HTML page, what is not as expected first."""
    bad = [result for result in results if not result.is_as_expected]
    good = [result for result in results if result.is_as_expected]
    sections = (
        section("Verdict", f"<p>{escape(verdict(results))}.</p>\n"),
        section("Not as expected", _table(bad)) if bad else "",
        section("As expected", _table(good)) if good else "",
        section("Facts of this campaign", pairs(facts)),
    )
    return page(_TITLE, _INTRODUCTION, sections)


def _table(results: Sequence[ScenarioResult]) -> str:
    """Two rows for each run: its figures, and below, as wide as the screen, the reasons and the command."""
    rows = []
    for result in results:
        name, *others = cells(result)
        data = "".join(f"<td>{escape(text)}</td>" for text in others)
        reasons = "".join(f"<span>{escape(part)}</span><br>" for part in (*result.why_not, result.reason) if part)
        kind = "" if result.is_as_expected else " bad"
        rows.append(
            f'<tr class="figures{kind}"><th scope="row">{escape(name)}</th>{data}</tr>\n'
            f'<tr class="again"><td colspan="{len(HEAD)}"><div>{reasons}<code>{escape(result.command)}</code></div>'
            "</td></tr>\n"
        )
    return table("Runs; below each its reason, and how to run it again", HEAD, rows)
