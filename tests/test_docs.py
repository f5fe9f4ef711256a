"""The pages are true: links, files, modules, names, tables, words; and they do not grow."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
import yaml

import plop
from plop.diagnosis.decision.result import Diagnosis, Ranked
from plop.diagnosis.decision.verdict import Verdict
from plop.parameters import Estimate
from plop.physics.effects.library import library
from plop.pipeline.registry import pipeline

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("**/*.md"), *ROOT.glob("benchmarks/*.md"), *ROOT.glob("studies/*.md")])
WRITTEN = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted(DOCS.glob("**/*.md"))]
MOST_WORDS = 19_980
"""Written by hand, all pages together. Whoever needs more finds what can go."""
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_PLACES = r"docs|plop|plop_cli|stages|tests|benchmarks|studies|scripts|changelog\.d"
_FILE = re.compile(rf"(?<![\w/.])(?:{_PLACES})/[\w./-]*[\w/]")
_SPAN = re.compile(r"`([^`\n]+)`")
NOT_PLAIN = re.compile(r"\b(shams?|loud(er|ness)?|doubts?|doubtful|told|heard|carried)\b", re.IGNORECASE)
"""Words for which the field has others: permutation test, signal, uncertainty, reported, measured, moved."""


def _hook(name: str) -> ModuleType:
    """Import one of the hooks that make pages, as mkdocs does."""
    if str(DOCS / "hooks") not in sys.path:
        sys.path.insert(0, str(DOCS / "hooks"))
    return importlib.import_module(name)


hook, references, tables = _hook("build_pages"), _hook("reference_pages"), _hook("result_tables")
tutorials, markdown = _hook("tutorial_pages"), _hook("markdown_parts")
GENERATED = {(DOCS / name).resolve() for name in (*references.PAGES, *tutorials.PAGES)}


def ids(page: Path) -> str:
    return str(page.relative_to(ROOT))


def sections(page: Path) -> set[str]:
    """Give the names by which a page's sections are linked to."""
    heads = [line.lstrip("#").strip() for line in _prose(page).splitlines() if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def _prose(page: Path) -> str:
    """Leave out blocks of code, in which # begins a comment."""
    return re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def broken_links(page: Path) -> list[str]:
    """List links that lead nowhere; sections of generated pages are looked at by `make docs`."""
    missing = []
    for link in _LINK.findall(_prose(page)):
        if "://" in link or link.startswith("mailto:"):
            continue
        name, _, section = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if target in GENERATED:
            continue
        if not target.exists() or (section and section not in sections(target)):
            missing.append(link)
    return missing


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_links_lead_somewhere(page: Path) -> None:
    assert broken_links(page) == []


def missing_files(text: str) -> list[str]:
    """List files, folders and modules of the project that a text names and that are not there."""
    named = {span for span in _SPAN.findall(text) for span in _FILE.findall(span) if "<" not in span}
    modules = set(re.findall(r"python -m ((?:benchmarks|studies|plop_cli)[\w.]*)", text))
    gone = [name for name in named if not (ROOT / name).exists()]
    gone += [name for name in modules if not _is_module(name)]
    return sorted(name for name in gone if "NAME" not in name)


def _is_module(name: str) -> bool:
    path = ROOT / Path(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_files_and_modules_on_a_page_are_there(page: Path) -> None:
    assert missing_files(page.read_text()) == []


def _strings(path: Path) -> list[str]:
    tree = ast.parse(path.read_text())
    return [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]


def test_pages_that_messages_name_are_there() -> None:
    code = [path for floor in ("plop", "stages", "plop_cli") for path in (ROOT / floor).rglob("*.py")]
    named = {
        (path.name, page) for path in code for text in _strings(path) for page in re.findall(r"docs/[\w/-]+\.md", text)
    }
    assert named and not [each for each in named if not (ROOT / each[1]).is_file()]


@pytest.mark.parametrize("page", WRITTEN, ids=ids)
def test_python_on_a_page_compiles_and_uses_public_names(page: Path) -> None:
    for block in re.findall(r"```python[^\n]*\n(.*?)```", page.read_text(), re.DOTALL):
        used = {
            node.attr
            for node in ast.walk(ast.parse(block))
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "plop"
        }
        used |= {
            alias.name
            for node in ast.walk(ast.parse(block))
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "plop"
            for alias in node.names
        }
        assert used <= set(plop.__all__)


@pytest.mark.parametrize("page", WRITTEN, ids=ids)
def test_words_are_those_of_the_field(page: Path) -> None:
    text = _SPAN.sub("", _prose(page))
    assert not NOT_PLAIN.findall(text)


def test_the_pages_do_not_grow_again() -> None:
    words = {ids(page): len(page.read_text().split()) for page in WRITTEN}
    assert sum(words.values()) <= MOST_WORDS, sorted(words.items(), key=lambda item: -item[1])[:8]
    assert words["docs/explanation/diagnosis.md"] <= 1_600


def test_every_page_is_in_the_contents() -> None:
    text = (ROOT / "mkdocs.yml").read_text()
    named = set(re.findall(r": ([\w/-]+\.md)$", text, re.MULTILINE))
    pages = {str(page.relative_to(DOCS)) for page in DOCS.glob("**/*.md")} | {*references.PAGES, *tutorials.PAGES}
    assert named == pages
    assert yaml.safe_load(text)["strict"] is True


def test_commands_and_settings_of_every_stage_are_in_the_reference() -> None:
    commands, settings = references.commands_page(), references.settings_page()
    written = (DOCS / "reference" / "outputs.md").read_text()
    for ref in pipeline():
        assert f"\n## {ref.command}\n" in commands and f"\n## {ref.command}\n" in settings
        assert f"\n## {ref.name}\n" in written, "what the stage writes"
    assert "`voxel_m`" in settings and "`0.002`" in settings and "[m]" in settings
    assert "\n## reproduce\n" in commands and "--dry-run" in commands


def test_every_effect_and_public_name_is_in_the_reference() -> None:
    effects, api = references.effects_page(), references.api_page()
    assert all(f"\n## {name}\n" in effects for name in library())
    assert all(f"#plop.{name} " in api for name in plop.__all__)


def test_the_layout_of_a_result_has_all_its_keys_and_the_values_of_enums() -> None:
    block = references.BLOCKS["diagnosis-json"]()
    assert f"schema {Diagnosis.SCHEMA}" in block and "`NONE OF THESE`" in block
    nested = (Diagnosis, Verdict, Ranked, Estimate)
    assert all(f"\n| `{each.name}` | `" in block for kind in nested for each in dataclasses.fields(kind))
    assert "| `ranking` | `list[Ranked]` | One for each law" in block


def test_a_bar_and_a_bracket_do_not_break_a_table() -> None:
    assert markdown.rows(["a"], [["x|y"]]).splitlines()[-1] == "| x\\|y |"
    assert markdown.escaped("`<a>` <b>") == "`<a>` &lt;b>"


@pytest.mark.parametrize("name", list(tables.TABLES))
def test_a_table_has_rows_and_says_where_it_is_from(name: str) -> None:
    lines = tables.table(name).splitlines()
    head = next(line for line in lines if line.startswith("|"))
    columns = head.count("|")
    rows = [line for line in lines if line.startswith("|")]
    assert len(rows) > 2
    assert all(row.replace("\\|", "").count("|") == columns for row in rows), "the same columns in every row"
    for source in tables.TABLES[name][1]:
        assert all(tables.provenance(source).values()), f"command, date, commit and machine of {source}"


def test_every_table_is_shown_once_and_every_place_has_a_table() -> None:
    asked = [found for page in WRITTEN for found in hook.PLACE.findall(page.read_text())]
    shown = [name for _, kind, name in asked if kind == "table"]
    assert sorted(shown) == sorted(tables.TABLES)
    assert {name for _, kind, name in asked if kind == "code"} == set(references.BLOCKS)
    folded = hook.filled("??? note\n\n    [[table speed]]\n").splitlines()
    assert len(folded) > 5 and all(line.startswith("    ") for line in folded[2:] if line)
    with pytest.raises(KeyError):
        hook.filled("[[table no-such]]")


def test_every_result_is_shown_or_named() -> None:
    shown = {source for _, sources in tables.TABLES.values() for source in sources}
    text = "".join(page.read_text() for page in WRITTEN)
    files = {path.stem for path in (DOCS / "results").glob("*.json")} - {"provenance"}
    kept = {"pressed", "discretisations-570"}  # figures that pages give in words
    assert files - shown - {name for name in files if f"docs/results/{name}.json" in text} <= kept
    assert set(json.loads((DOCS / "results" / "provenance.json").read_text())) <= files


def test_nothing_writes_into_pages() -> None:
    assert not [ids(page) for page in PAGES if re.search(r"<!-- [\w-]+:(begin|end) -->", page.read_text())]


def test_the_tutorial_becomes_a_page_with_all_its_code() -> None:
    page = tutorials.script_page(DOCS / "tutorials" / "planner.py")
    assert page.startswith("# A model in a planner's loop\n")
    code = "\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL))
    ast.parse(code)
    assert "model.step(state, action)" in page and "plop.augment(" in code


def test_changes_have_a_kind_that_the_page_knows() -> None:
    kinds = {"added", "changed", "fixed", "removed"}
    names = [path.name for path in (ROOT / "changelog.d").glob("*.md")]
    assert all(name.split(".")[1] in kinds for name in names)
    assert all(path.read_text().strip() in tutorials.changes_page() for path in (ROOT / "changelog.d").glob("*.md"))
    assert len((ROOT / "CHANGELOG.md").read_text().splitlines()) <= 80


def test_a_broken_page_is_noticed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One, two (3)\n```\n# no section\n```\n[a](#one-two-3) [b](#no-section) [c](none.md)")
    assert sections(page) == {"one-two-3"} and broken_links(page) == ["#no-section", "none.md"]
    assert missing_files("`plop/none.py` and `python -m benchmarks.none`") == ["benchmarks.none", "plop/none.py"]
    assert NOT_PLAIN.search("Shams are loud.")
