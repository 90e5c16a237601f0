"""A page as a browser shows it: wide, narrow, on paper; what it asks the network for."""

import html as markup
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from helpers import traces

from imutui.jobs import residual_curves
from imutui.report import html, page

WIDTHS = (1280, 400)
MEASURE = """
<script>
addEventListener("load", () => {
  const told = [...document.querySelectorAll("iframe")].map(frame => {
    const own = frame.contentDocument, wide = own.documentElement.clientWidth;
    const out = [...own.body.querySelectorAll("*")].filter(e => {
      const box = e.getBoundingClientRect();
      return box.width > 0 && (box.right > wide + 1 || box.left < -1) && getComputedStyle(e).clip === "auto"
        && !e.closest("thead") && !e.closest("clipPath");
    });
    const pictures = [...own.querySelectorAll("figure svg")].map(svg => ({
      width: svg.getBoundingClientRect().width,
      x: svg.querySelectorAll("[id$=-matplotlib\\\\.axis_1] text").length,
      y: svg.querySelectorAll("[id$=-matplotlib\\\\.axis_2] text").length,
      size: Math.min(...[...svg.querySelectorAll("text")].map(t => t.getBoundingClientRect().height)),
    }));
    const ids = [...own.querySelectorAll("[id]")].map(e => e.id);
    return {wide, scroll: own.documentElement.scrollWidth, out: out.map(e => e.outerHTML.slice(0, 80)), pictures,
            requests: frame.contentWindow.performance.getEntriesByType("resource").map(e => e.name),
            twice: ids.length - new Set(ids).size, text: own.body.innerText.length};
  });
  const made = document.createElement("pre");
  made.id = "told"; made.textContent = JSON.stringify(told);
  document.body.append(made);
});
</script>
"""


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """What a browser says of a page with everything on it, at each width."""
    pytest.importorskip("matplotlib")
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no chromium here: apt-get install chromium")
    folder: Path = tmp_path_factory.mktemp("browser")
    run = {"id": "a_long_name_of_a_run_" * 3, "kind": "simulated", "rate_hz": 20.0, "seconds": 900.0}
    run |= {"log": "/data/" + "2026-11-23T01-14-22_IMU400CD-200_" * 2 + ".mcap", "log_sha256": "0123456789abcdef" * 4}
    curves = residual_curves.curves(traces.trace(("a",)).series, None)
    whole = html.document(page.page([{**traces.document(), "runs": [run, run], "curves": curves}]))
    (folder / "page.html").write_text(whole)
    frames = "".join(f'<iframe width="{w}" height="900" srcdoc="{markup.escape(whole)}"></iframe>' for w in WIDTHS)
    (folder / "measured.html").write_text(f"<!doctype html><body>{frames}{MEASURE}")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command += ["--virtual-time-budget=20000", "--dump-dom", (folder / "measured.html").as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    found = re.search(r'<pre id="told">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    assert found, done.stderr
    told: list[dict[str, Any]] = json.loads(markup.unescape(found[1]))
    return told


def test_nothing_is_wider_than_the_window(shown: list[dict[str, Any]]) -> None:
    """At a desk and on a telephone."""
    for told in shown:
        assert told["text"] > 1000
        assert told["scroll"] <= told["wide"], told["wide"]
        assert told["out"] == [], told["wide"]


def test_every_figure_is_there_with_numbers_on_both_axes(shown: list[dict[str, Any]]) -> None:
    """Numbers and a name, none smaller than can be read; no name inside a picture is used twice."""
    for told in shown:
        assert len(told["pictures"]) == 6 * 3 + 2
        for picture in told["pictures"]:
            assert picture["x"] >= 2
            assert picture["y"] >= 3
            assert picture["size"] >= 8.0, told["wide"]
            assert picture["width"] > 200.0
        assert told["twice"] == 0


def test_a_page_requests_nothing(shown: list[dict[str, Any]]) -> None:
    """And is not allowed to."""
    assert [told["requests"] for told in shown] == [[], []]
