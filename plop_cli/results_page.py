"""Write the figures of `plop reproduce`: docs/results/disect.json, and tables and pictures in docs/results.md."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plop.artifacts.whole_file import write_text
from plop.metrics.table import replace_between_markers, to_markdown

PARTS = ("episode", "end", "start")
"""Each part has its table between the markers `disect-<part>` of the page."""


def write_results(docs: Path, results: Mapping[str, Any], pictures: Mapping[str, Path]) -> list[Path]:
    """Write all results.

    Args:
        docs: Folder of the documentation: results.md (when it is there) and results/.
        results: From `plop.metrics.table.collect`.
        pictures: Per environment the picture of one test episode.

    Returns:
        The files that were written.
    """
    folder = docs / "results"
    write_text(folder / "disect.json", json.dumps(results, indent=1) + "\n")
    written = [folder / "disect.json"]
    links = []
    for name, source in pictures.items():
        target = folder / "pictures" / f"{name}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
        links.append(f"### {name}\n![{name}: measured, predicted, difference](results/pictures/{name}.png)")
    page = docs / "results.md"
    if page.is_file():
        text = page.read_text(encoding="utf-8")
        for part in PARTS:
            text = replace_between_markers(text, f"disect-{part}", to_markdown(results, part=part))
        text = replace_between_markers(text, "disect-pictures", "\n\n".join(links) or "None.")
        write_text(page, text)
        written.append(page)
    return written
