"""Pages generated from other files: the tutorial that runs as a script, and the changelog."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def script_page(path: Path) -> str:
    """Turn a script of cells (`# %%`, `# %% [markdown]`) into Markdown."""
    parts = []
    for cell in re.split(r"^# %%", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        head, _, body = cell.partition("\n")
        if "[markdown]" in head:
            parts.append("\n".join(line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines()))
        else:
            parts.append(f"```python\n{body.strip()}\n```")
    return "\n\n".join(parts) + "\n"


def changes_page() -> str:
    """Return the changelog: unreleased fragments, then CHANGELOG.md."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["towncrier"]
    titles = {kind["directory"]: kind["name"] for kind in settings["type"]}
    fragments = sorted((ROOT / settings["directory"]).glob("*.md"))
    lines = []
    for kind, title in titles.items():
        found = [path for path in fragments if path.name.split(".")[1] == kind]
        lines += [f"### {title}\n", *(f"- {path.read_text(encoding='utf-8').strip()}" for path in found), ""] * bool(
            found
        )
    released = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](../")
    head, mark, rest = released.partition(f"{settings['start_string']}\n")
    return "\n".join([head.strip(), "", "## Not released\n", *lines, rest]) if lines else released


PAGES: dict[str, Callable[[], str]] = {
    "tutorials/planner.md": lambda: script_page(ROOT / "docs" / "tutorials" / "planner.py"),
    "develop/changes.md": changes_page,
}
"""Place in docs/ -> what makes the page."""
