# SPDX-License-Identifier: MIT
from segway_ecc.hil.page import page, pairs, section, table_row, wide

SCRIPT = "<script>'&\"</script>"
ESCAPED = "&lt;script&gt;&#x27;&amp;&quot;&lt;/script&gt;"


def test_a_page_has_its_title_twice_its_introduction_and_its_sections_in_order() -> None:
    text = page("A & B", "1 < 2", ["<p>one</p>\n", "<p>two</p>\n"])
    assert text.startswith('<!DOCTYPE html>\n<html lang="en">\n')
    assert "<title>A &amp; B</title>" in text
    assert "<h1>A &amp; B</h1>\n<p>1 &lt; 2</p>\n<p>one</p>\n<p>two</p>\n</main>" in text
    assert text.endswith("</body>\n</html>\n")


def test_a_page_holds_its_style_and_loads_nothing() -> None:
    text = page("t", "i", [])
    style = text[text.index("<style>\n") : text.index("</style>")]
    for rule in ("color-scheme: light dark", ".wide {\n  overflow-x: auto", ".bad td:nth-of-type(8)", "code {"):
        assert rule in style
    for word in ("url(", "@import", "src=", "href=", "http"):
        assert word not in text


def test_a_section_has_a_heading() -> None:
    assert section(SCRIPT, "<p>x</p>\n") == f"<section>\n<h2>{ESCAPED}</h2>\n<p>x</p>\n</section>\n"


def test_what_is_wide_can_be_scrolled_with_the_keyboard_and_has_a_label() -> None:
    expected = f'<div class="wide" role="region" aria-label="{ESCAPED}" tabindex="0">\n<p>x</p>\n</div>\n'
    assert wide(SCRIPT, "<p>x</p>\n") == expected


def test_pairs_are_a_list() -> None:
    assert pairs({"a": "1", SCRIPT: SCRIPT}) == (
        f"<dl>\n<dt>a</dt>\n<dd>1</dd>\n<dt>{ESCAPED}</dt>\n<dd>{ESCAPED}</dd>\n</dl>\n"
    )


def test_a_cell_that_holds_sentences_is_broken_and_others_are_not() -> None:
    sentence = "the guard stops the drives; torque is zero"
    assert table_row(["0.3", sentence, SCRIPT]) == (
        f'<tr><td>0.3</td><td class="prose">{sentence}</td><td>{ESCAPED}</td></tr>\n'
    )
