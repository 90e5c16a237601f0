"""Blocks of a page: every kind of them can be written, on a terminal as on a page."""

from typing import get_args

import pytest

from imutui.report import html, plain
from imutui.report.blocks import (
    Article,
    Block,
    Code,
    Column,
    Facts,
    Figure,
    Items,
    Page,
    Paragraph,
    Section,
    Subheading,
    Table,
)
from imutui.report.numbers import NOTHING

BLOCKS: tuple[Block, ...] = (
    Paragraph("All units pass."),
    Subheading("Units"),
    Items(("one", "two"), numbered=True),
    Facts((("Serial number", "9911750"), ("Where it was recorded, and by whom", "the laboratory " * 5))),
    Table((Column("Unit", "code"),), (("U1",),)),
    Code('[filter]\nname = "spkf"', folded="The configuration"),
    Figure("nis", "NIS", "below the line", ()),
)


def test_every_kind_of_block_has_an_example() -> None:
    assert {type(block) for block in BLOCKS} == set(get_args(Block))


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: type(block).__name__)
def test_every_block_is_lines_of_the_width(block: Block) -> None:
    lines = plain.lines([block], 40).splitlines()
    assert all(len(line) <= 40 for line in lines)
    assert bool(lines) is not isinstance(block, Figure)


def test_facts_stand_beside_their_labels_and_code_is_as_it_is() -> None:
    assert plain.lines([BLOCKS[3]], 60).splitlines()[0] == "Serial number                   9911750"
    assert plain.lines([BLOCKS[5]], 60).splitlines() == ["The configuration", "[filter]", 'name = "spkf"']


def test_a_figure_without_panels_is_left_out() -> None:
    """Of a trace of constant readings every channel is set aside."""
    article = Article("Trace", "unknown", "", (Section("Noise", (BLOCKS[6],)),))
    assert article.figures() == []
    assert "<figure" not in html.document(Page("Trace", (article,)))


def test_a_page_links_to_files_and_not_to_what_is_not_there() -> None:
    table = Table((Column("Page", "link"),), (("U1/index.html",), (NOTHING,)))
    page = html.document(Page("Batch", (Article("Batch", "unknown", "", (Section("Units", (table,)),)),)))
    assert 'href="U1/index.html"' in page
    assert f'href="{NOTHING}"' not in page
