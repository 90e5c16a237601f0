"""Figures as pictures. The only user of matplotlib, which is an extra: `pip install 'imutui[report]'`.

No global state: figures are made by hand, and equal results give equal files. A page has each panel as a picture of its
own, so that its numbers can be read on a narrow screen; a file has all panels of a figure.
"""

import importlib.util
import io
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import TYPE_CHECKING

from imutui.plain_text import visible
from imutui.report.axes import AFTER, BEFORE, FLOOR, INK, plain
from imutui.report.blocks import Article, Figure, Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

KINDS = ("svg", "png")
_SVG, _XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
_SIZE = (4.6, 2.7)
_DPI = 150
_PAGE_COLOURS = {INK: "currentColor", BEFORE: "var(--before)", AFTER: "var(--after)", FLOOR: "var(--floor)"}


def available() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def picture(panel: Panel, label: str, prefix: str) -> str:
    """A panel as SVG inside a page: its text is text, its colours are the page's, its names are its own.

    `label`: told to who cannot see it.
    `prefix`: what names inside the picture begin with; no other picture of the page has it.
    """
    root = ElementTree.fromstring(_saved([panel], "svg"))
    for metadata in root.findall(f"{{{_SVG}}}metadata"):
        root.remove(metadata)
    for element in root.iter():
        for key, value in list(element.attrib.items()):
            element.set(key, _of_page(key, value, prefix))
    for size in ("width", "height"):
        root.attrib.pop(size, None)
    root.attrib |= {"role": "img", "aria-label": visible(label)}
    ElementTree.register_namespace("", _SVG)
    ElementTree.register_namespace("xlink", _XLINK)
    return ElementTree.tostring(root, encoding="unicode")


def files(article: Article, prefix: str) -> dict[str, bytes]:
    """Contents of the files of an article's figures, by names that begin with a prefix."""
    return {f"{prefix}{figure.name}.{kind}": file(figure, kind) for figure in article.figures() for kind in KINDS}


def file(figure: Figure, kind: str) -> bytes:
    """All panels of a figure as the content of a file of one of the `KINDS`."""
    return _saved(figure.panels, kind, background="white")


def _of_page(key: str, value: str, prefix: str) -> str:
    if key == "id":
        return f"{prefix}-{value}"
    if key.endswith("href") and value.startswith("#"):
        return f"#{prefix}-{value[1:]}"
    for colour, variable in _PAGE_COLOURS.items():
        value = value.replace(colour, variable)
    return value.replace("url(#", f"url(#{prefix}-")


def _saved(panels: Sequence[Panel], kind: str, background: str = "none") -> bytes:
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    columns = 2 if len(panels) > 1 else 1
    rows = -(-len(panels) // columns)
    with mpl.rc_context(
        {
            "svg.fonttype": "none",
            "svg.hashsalt": "imutui",
            "font.size": 8.5,
            "font.family": ["DejaVu Sans", "sans-serif"],
            "text.color": INK,
            "axes.labelcolor": INK,
            "axes.edgecolor": INK,
            "axes.linewidth": 0.6,
            "xtick.color": INK,
            "ytick.color": INK,
            "path.simplify_threshold": 0.3,
        }
    ):
        canvas = Canvas(figsize=(_SIZE[0] * columns, _SIZE[1] * rows), facecolor=background)
        for n, panel in enumerate(panels):
            # places are fixed: a layout that is solved for costs more than all the curves
            ax = canvas.add_axes(_place(n, columns, rows), facecolor="none")
            panel.draw(ax)
            ax.set_title(plain(panel.name), fontsize="medium", loc="left")
        stream = io.BytesIO()
        _draw(canvas, stream, kind)
    return stream.getvalue()


def _place(n: int, columns: int, rows: int) -> tuple[float, float, float, float]:
    row, column = divmod(n, columns)
    left, bottom, width, height = 0.165, 0.185, 0.80, 0.70
    return (column + left) / columns, (rows - 1 - row + bottom) / rows, width / columns, height / rows


def _draw(canvas: "Canvas", stream: io.BytesIO, kind: str) -> None:
    if kind == "svg":
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        FigureCanvasSVG(canvas)
        canvas.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
        return
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(canvas)
    canvas.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
