"""What the pages point to is there: files, sections, and results."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("benchmarks/*.md")])
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_RESULT = re.compile(r"docs/results/[a-z0-9_.-]+\.json")


def sections(page: Path) -> set[str]:
    """Give the names by which a page's sections are linked to, as GitHub makes them."""
    heads = [line.lstrip("#").strip() for line in _prose(page) if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def _prose(page: Path) -> list[str]:
    """Leave out blocks of code, in which # begins a comment."""
    return re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL).splitlines()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path):
    text = "\n".join(_prose(page))
    missing = []
    for link in _LINK.findall(text):
        if "://" in link or link.startswith("mailto:"):
            continue
        name, _, section = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if not target.exists() or (section and section not in sections(target)):
            missing.append(link)
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_results_that_a_page_names_are_kept(page: Path):
    assert [name for name in _RESULT.findall(page.read_text()) if not (ROOT / name).is_file()] == []


def test_a_broken_link_is_noticed(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("# One, two (3)\n```\n# no section\n```\n[a](#one-two-3) [b](#no-section)")
    assert sections(page) == {"one-two-3"}
