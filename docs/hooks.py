"""What mkdocs shows beside docs/: README.md as its first page, CONTRIBUTING.md, CHANGELOG.md, pictures of the screen.

All of them lie elsewhere in the repository and are linked as a reader of the repository needs it. Here they become
files of the site, and the links to them follow.
"""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
TOP = {"README.md": "index.md", "CONTRIBUTING.md": "CONTRIBUTING.md", "CHANGELOG.md": "CHANGELOG.md"}
PICTURE = re.compile(r"\((?:\.\./)?(tests/tui/__snapshots__/[^)\s]+\.svg)\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from the top of the repository, and every picture that a page shows."""
    for source, name in TOP.items():
        files.append(File.generated(config, name, content=(ROOT / source).read_text()))
    texts = [file.content_string for file in files if file.src_uri.endswith(".md")]
    for picture in sorted({path for text in texts for path in PICTURE.findall(text)}):
        files.append(File.generated(config, _name(picture), abs_src_path=str(ROOT / _unquoted(picture))))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links to the top of the repository and to pictures lead to the files of the site."""
    for source, name in TOP.items():
        markdown = markdown.replace(f"](../{source}", f"]({name}").replace(f"]({source}", f"]({name}")
    return PICTURE.sub(lambda match: f"({_name(match[1])})", markdown.replace("](docs/", "]("))


def _name(picture: str) -> str:
    """Name on the site, such as pictures/80x24-filter.svg."""
    words = re.findall(r"\[([^\]]+)\]", _unquoted(picture))
    return f"pictures/{'-'.join(words)}.svg"


def _unquoted(picture: str) -> str:
    return picture.replace("%5B", "[").replace("%5D", "]")
