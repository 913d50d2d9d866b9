# SPDX-License-Identifier: MIT
"""What the page's source must not hold: ways for text to become HTML, inline code, other machines, size."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[4] / "deploy" / "station" / "page"
OURS = sorted(path for path in PAGE.iterdir() if path.suffix in {".js", ".html", ".css", ".svg"})
MODULES = [path for path in OURS if path.suffix == ".js"]
TO_HTML = (
    r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|createContextualFragment|srcdoc|DOMParser"
    r"|\beval\b|new Function"
)


def test_the_page_is_there() -> None:
    assert {"app.js", "connection.js", "driving.js", "stop.js", "index.html", "style.css"} <= {
        path.name for path in OURS
    }


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.name)
def test_no_text_can_become_html_or_code(path: Path) -> None:
    assert re.findall(TO_HTML, path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("path", OURS, ids=lambda path: path.name)
def test_nothing_comes_from_another_machine(path: Path) -> None:
    text = path.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
    assert re.findall(r"https?://|@import|//cdn|url\(", text) == []


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.name)
def test_nothing_is_kept_in_the_browser(path: Path) -> None:
    """Who comes next at this screen finds nothing of who was before; and so do tests that share a tab."""
    kept = r"localStorage|sessionStorage|indexedDB|document\.cookie|\bcaches\b|serviceWorker|navigator\.storage"
    assert re.findall(kept, path.read_text(encoding="utf-8")) == []


def test_the_page_holds_no_inline_script_or_style() -> None:
    html = (PAGE / "index.html").read_text(encoding="utf-8")
    assert re.findall(r"<style|\sstyle=|\son\w+=|javascript:|<script(?![^>]* src=)", html) == []


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.name)
def test_a_module_is_small_enough_to_read(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 250
    assert max(map(len, lines)) <= 140
    assert lines[0].startswith("// "), "its first line says what it is for"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.name)
def test_every_import_is_a_file_of_the_page(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for name in re.findall(r'from "(.+?)"', text):
        assert name.startswith("./")
        assert (PAGE / name).is_file(), name


def test_each_library_has_its_licence_beside_it() -> None:
    assert "MIT License" in (PAGE / "vendor" / "LICENSE-uPlot").read_text(encoding="utf-8")
    assert "three.js authors" in (PAGE / "vendor" / "LICENSE-three").read_text(encoding="utf-8")
    assert "v1.6.32" in (PAGE / "vendor" / "uplot.js").read_text(encoding="utf-8")[:400]
