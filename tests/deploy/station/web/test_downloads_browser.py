# SPDX-License-Identifier: MIT
"""What a browser makes of the page of logs: its form is ours by its origin, and works without any script."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.chromium import OPTIONS
from tests.deploy.station.playback.log_maker import story, write_log
from tests.deploy.station.web.serving import served
from tests.deploy.station.web.test_downloads import ScriptedArchive, alice_and_others
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.browser


def test_a_log_is_fetched_and_downloaded_by_hand(tmp_path: Path) -> None:
    from playwright.async_api import async_playwright  # noqa: PLC0415 - it may not be there

    (tmp_path / "fetched").mkdir()
    archive = ScriptedArchive(tmp_path / "fetched")

    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            async_playwright() as playwright,
            await playwright.chromium.launch(**OPTIONS) as chromium,
        ):
            page = await chromium.new_page()
            page.set_default_timeout(PATIENCE_S * 1e3)
            await page.goto(here.url)
            await _until(lambda: len(here.server.hub) > 0)
            await page.goto(f"{here.url}/logs")
            await page.get_by_role("button", name="Fetch a<b>.mcap").click()
            await page.get_by_role("progressbar", name="a<b>.mcap").wait_for()
            assert archive.begun == [("/alice", "a<b>.mcap")]
            archive.arrive()
            link = page.get_by_role("link", name="a<b>.mcap", exact=True)
            await link.wait_for()  # the page looks again by itself
            async with page.expect_download() as download:
                await link.click()
            file = await (await download.value).path()
            assert await asyncio.to_thread(Path(file).read_bytes) == b"0123456789"
            assert here.refused() == {}

    asyncio.run(scenario())


def test_a_log_is_played_by_hand_and_by_nobody_without_a_session(tmp_path: Path) -> None:
    from playwright.async_api import async_playwright  # noqa: PLC0415 - it may not be there

    async def scenario(tokens: bool) -> None:  # noqa: FBT001 - of a test
        async with (
            served(tmp_path, tokens=tokens, station=alice_and_others()) as here,
            async_playwright() as playwright,
            await playwright.chromium.launch(**OPTIONS) as chromium,
        ):
            page = await chromium.new_page()
            page.set_default_timeout(PATIENCE_S * 1e3)
            if tokens:
                await page.goto(f"{here.url}/log#log=run.mcap")
                await page.get_by_text("sign in at the base station first").wait_for()
                await page.get_by_role("link", name="Base station").wait_for()
                return
            await page.goto(here.url)
            await _until(lambda: len(here.server.hub) > 0)
            await page.goto(f"{here.url}/logs")
            await page.get_by_role("link", name="Play run.mcap").click()
            await page.get_by_text("2.995 s, 600 cycles").wait_for()
            await page.get_by_role("button", name="+1 cycle").click()
            await page.wait_for_function("() => document.body.dataset.cycle === '1'")
            await page.get_by_role("link", name="All logs").click()
            await page.get_by_role("link", name="Play run.mcap").wait_for()
            assert here.refused() == {}

    (tmp_path / "logs").mkdir()
    write_log(tmp_path / "logs" / "run.mcap", story(3.0))
    for tokens in (False, True):
        asyncio.run(scenario(tokens))


async def _until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - the server tells nobody
            await asyncio.sleep(0.02)
