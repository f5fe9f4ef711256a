"""The hook of mkdocs: pages from code, tables from results, equations as MathML.

A line `[[table NAME]]` of a page is replaced by the table of that name (`result_tables.TABLES`), `[[code NAME]]` by the
block that `reference_pages.BLOCKS` makes from the code. Pages of `reference_pages.PAGES` have no file at all.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import reference_pages  # noqa: E402
import result_tables  # noqa: E402
import tutorial_pages  # noqa: E402

PLACE = re.compile(r"^( *)\[\[(table|code) ([\w-]+)\]\]$", re.MULTILINE)
"""Placeholder of generated content in a page."""
_MATH = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_startup(**_: Any) -> None:
    """Let the pages' code import benchmarks/ while they are built: mkdocs takes back what its hooks add to sys.path."""
    sys.path.insert(0, str(ROOT))


def generated() -> dict[str, str]:
    """Return the Markdown of all pages that are made while the site is built, by their place in docs/."""
    pages = {name: make() for name, make in reference_pages.PAGES.items()}
    return pages | {name: make() for name, make in tutorial_pages.PAGES.items()}


def filled(markdown: str) -> str:
    """Insert tables and blocks where a page asks for them.

    Raises:
        KeyError: There is none of that name.
    """

    def content(found: re.Match[str]) -> str:
        indent, kind, name = found.groups()
        text = result_tables.table(name) if kind == "table" else reference_pages.BLOCKS[name]()
        return "\n".join(indent + line if line else "" for line in text.splitlines())

    return PLACE.sub(content, markdown)


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages."""
    from mkdocs.structure.files import File

    for name, text in generated().items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Fill a page; an unknown table or block is an error that names the page."""
    from mkdocs.exceptions import PluginError

    try:
        return filled(markdown)
    except KeyError as error:
        raise PluginError(f"{page.file.src_uri} asks for {error}, or a result lacks this key") from error


def on_page_content(html: str, **_: Any) -> str:
    """Convert equations to MathML, which browsers render natively: no script, nothing is downloaded."""
    from html import unescape

    from latex2mathml.converter import convert

    def drawn(found: re.Match[str]) -> str:
        block = found[1] == "div"
        math = convert(unescape(found[2]).strip(), display="block" if block else "inline")
        return f'<div class="equation">{math}</div>' if block else math

    return _MATH.sub(drawn, html)
