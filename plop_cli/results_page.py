"""Write the figures of `plop reproduce`: docs/results/disect.json, and tables and pictures in docs/results.md.

Those of another profile than `cpu` go beside them, into files, and between markers, that bear its name.
Part recordings (the halves are pushed apart) are the test; plain cuts, in which hardly anything moves, have tables of
their own, and `all` holds both kinds together.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plop.artifacts.atomic_file import write_text
from plop.metrics.table import ScoreFiles, collect, gains_to_markdown, has_place, replace_between_markers, to_markdown

MAIN = "cpu"
"""The profile whose results bear no profile's name."""
PARTS = ("episode", "end", "start")
"""Each part has its table between the markers `disect-<part>` of the page."""


def is_part(episode: str) -> bool:
    """Tell whether a recording is one in which the halves are pushed apart."""
    return "_part_" in episode


def gathered(scores: ScoreFiles, *, command: str, versions: Mapping[str, str], seeds: Sequence[int]) -> dict[str, Any]:
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


def write_results(docs: Path, results: Mapping[str, Any], pictures: Mapping[str, Path], profile: str) -> list[Path]:
    """Write all results.

    Args:
        docs: Folder of the documentation: results.md (when it is there) and results/.
        results: From `gathered`.
        pictures: Per environment the picture of one test episode.
        profile: Name of the profile that made them. The page must have a place for each table of `cpu`; of another
            profile's it takes those that it has a place for.

    Returns:
        The files that were written.
    """
    stem = _stem(profile)
    shown = "pictures" if profile == MAIN else f"pictures-{profile}"
    written = [docs / "results" / f"{stem}.json"]
    write_text(written[0], json.dumps(results, indent=1) + "\n")
    links = []
    for name, source in pictures.items():
        target = docs / "results" / shown / f"{name}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
        title = name if profile == MAIN else f"{name}, {profile}"
        links.append(f"### {title}\n![{title}: measured, predicted, difference](results/{shown}/{name}.png)")
    page = docs / "results.md"
    if page.is_file():
        text = page.read_text(encoding="utf-8")
        for name, content in {**_tables(results), "pictures": "\n\n".join(links) or "None."}.items():
            if profile == MAIN or has_place(text, f"{stem}-{name}"):
                text = replace_between_markers(text, f"{stem}-{name}", content)
        write_text(page, text)
        written.append(page)
    return written


def missing_in(results: Mapping[str, Any], docs: Path, profile: str) -> list[str]:
    """List the environments of the results that are there already which the new ones lack."""
    try:
        there = json.loads((docs / "results" / f"{_stem(profile)}.json").read_text(encoding="utf-8"))["environments"]
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return sorted(there.keys() - results["environments"].keys())


def _stem(profile: str) -> str:
    return "disect" if profile == MAIN else f"disect-{profile}"


def _tables(results: Mapping[str, Any]) -> dict[str, str]:
    """Give the tables in Markdown by the ends of their markers' names."""
    tables = {part: to_markdown(results, part=part) for part in PARTS}
    for name, each in {"gains": results, "gains-plain": results["plain"], "gains-all": results["all"]}.items():
        tables[name] = gains_to_markdown(each)
    return {**tables, "plain": to_markdown(results["plain"])}
