# SPDX-License-Identifier: MIT
"""The documentation: links, anchors, pages of the site, and the names that it gives to code."""

import ast
import re
from pathlib import Path

import pytest
import yaml

import segway_ecc
from segway_ecc.node.cli.main import find_verbs

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
AT_ROOT = [
    ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "examples/README.md")
]
LINK = re.compile(r"\]\(([^)\s]+)\)")
PATH = re.compile(r"`((?:firmware_io|node|deploy|hil|tests|segway_ecc|docs|examples|yocto-notes)/[\w./-]*)`")
CODE = re.compile(r"`([\w/]+\.py)`: ((?:`[\w.]+`(?:, )?)+)")


def anchors(path: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.+)$", path.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", [*PAGES, *AT_ROOT], ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_leads_somewhere(path: Path) -> None:
    broken = []
    for link in LINK.findall(path.read_text("utf-8")):
        target, _, anchor = link.partition("#")
        if "://" in target or target.startswith("mailto:"):
            continue
        place = path if not target else path.parent / target
        if not place.exists() or (anchor and anchor not in anchors(place)):
            broken.append(link)
    assert broken == []


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_page_of_the_site_links_to_pages_of_the_site(path: Path) -> None:
    targets = [link.partition("#")[0] for link in LINK.findall(path.read_text("utf-8")) if "://" not in link]
    assert [target for target in targets if target and DOCS not in (path.parent / target).resolve().parents] == []


def test_the_site_has_every_page_once() -> None:
    def listed(entries: object) -> list[str]:
        if isinstance(entries, str):
            return [entries]
        values = entries.values() if isinstance(entries, dict) else entries if isinstance(entries, list) else []
        return [page for entry in values for page in listed(entry)]

    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))["nav"]
    assert sorted(listed(nav)) == [path.relative_to(DOCS).as_posix() for path in PAGES]


@pytest.mark.parametrize("path", [DOCS / "architecture.md", ROOT / "CONTRIBUTING.md", ROOT / "README.md"], ids=str)
def test_every_file_that_is_named_exists(path: Path) -> None:
    named = PATH.findall(path.read_text("utf-8"))
    assert [name for name in named if not (ROOT / name).exists()] == []


def defined(path: Path) -> set[str]:
    """The functions, classes and methods of a module."""
    names = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{inner.name}" for inner in node.body if isinstance(inner, ast.FunctionDef)}
    return names


def test_every_function_that_the_architecture_names_is_where_it_says() -> None:
    found = CODE.findall((DOCS / "architecture.md").read_text("utf-8"))
    missing = [
        f"{file}: {name}"
        for file, names in found
        for name in re.findall(r"`([\w.]+)`", names)
        if name not in defined(ROOT / file)
    ]

    assert len(found) > 15
    assert missing == []


def test_the_reference_has_every_verb() -> None:
    text = (DOCS / "reference.md").read_text("utf-8")
    verbs = [verb.name for verb in find_verbs().values() if verb.package is not None]

    assert len(verbs) > 30
    assert [name for name in verbs if f"`{name}" not in text] == []


def test_the_reference_has_every_public_name() -> None:
    text = (DOCS / "reference.md").read_text("utf-8").partition("## Public API")[2]
    assert [name for name in segway_ecc.__all__ if f"`{name}`" not in text] == []


OLD_VERBS = re.compile(
    r"segway-ecc (inspect|simulate|margins|replay|traffic|support-bundle|archive|supervise|status|base-station|image"
    r"|doctor|hil|campaign|kill-drill|failover|endurance|soak|study)\b"
)


@pytest.mark.parametrize(
    "path", [*PAGES, ROOT / "README.md", ROOT / "examples" / "README.md"], ids=lambda path: path.name
)
def test_no_page_names_a_verb_of_version_0_1(path: Path) -> None:
    assert OLD_VERBS.findall(path.read_text("utf-8")) == []
