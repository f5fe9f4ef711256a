"""Write the figures of `plop reproduce`: docs/results/disect.json, and tables and pictures in docs/results.md.

Part recordings (the halves are pushed apart) are the test; plain cuts, in which hardly anything moves, have tables of
their own, and `all` holds both kinds together.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plop.artifacts.whole_file import write_text
from plop.metrics.table import Scores, collect, gains_to_markdown, replace_between_markers, to_markdown

PARTS = ("episode", "end", "start")
"""Each part has its table between the markers `disect-<part>` of the page."""


def is_part(episode: str) -> bool:
    """Tell whether a recording is one in which the halves are pushed apart."""
    return "_part_" in episode


def gathered(scores: Scores, *, command: str, versions: Mapping[str, str], seeds: Sequence[int]) -> dict[str, Any]:
    """Gather the scores: of the part recordings, and under "plain" and "all" those of plain cuts and of both kinds.

    Args:
        scores: Per environment the scores.json of every seed.
        command: Command that made them.
        versions: Versions of the software.
        seeds: Seeds of the trainings.
    """
    found = collect(scores, chosen=is_part, command=command, versions=versions, seeds=seeds)
    others = {"plain": collect(scores, chosen=lambda name: not is_part(name)), "all": collect(scores)}
    return found | {name: {key: other[key] for key in ("environments", "mean")} for name, other in others.items()}


def write_results(docs: Path, results: Mapping[str, Any], pictures: Mapping[str, Path]) -> list[Path]:
    """Write all results.

    Args:
        docs: Folder of the documentation: results.md (when it is there) and results/.
        results: From `gathered`.
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
        for name, each in {"gains": results, "gains-plain": results["plain"], "gains-all": results["all"]}.items():
            text = replace_between_markers(text, f"disect-{name}", gains_to_markdown(each))
        text = replace_between_markers(text, "disect-plain", to_markdown(results["plain"]))
        text = replace_between_markers(text, "disect-pictures", "\n\n".join(links) or "None.")
        write_text(page, text)
        written.append(page)
    return written
