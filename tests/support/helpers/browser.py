"""What a browser says of a page: sizes, figures, requests; at a desk and on a telephone."""

import html as markup
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

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


def measured(whole: str, folder: Path) -> list[dict[str, Any]]:
    """What a browser says of a page at each width; the test is skipped where there is no browser.

    `whole`: text of the page.
    `folder`: empty, for the files that it takes.
    """
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no chromium here: apt-get install chromium")
    frames = "".join(f'<iframe width="{w}" height="900" srcdoc="{markup.escape(whole)}"></iframe>' for w in WIDTHS)
    (folder / "measured.html").write_text(f"<!doctype html><body>{frames}{MEASURE}")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command += ["--virtual-time-budget=20000", "--dump-dom", (folder / "measured.html").as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    found = re.search(r'<pre id="told">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    assert found, done.stderr
    told: list[dict[str, Any]] = json.loads(markup.unescape(found[1]))
    return told
