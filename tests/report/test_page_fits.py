"""Pages of every kind of run: what they must say, what they must not, and that they fit a phone."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html import escape, unescape
from pathlib import Path

import pytest

from plop.diagnosis.decision.result import Diagnosis
from plop.diagnosis.decision.verdict import Reason
from plop.parameters import NOT_DETERMINED, Estimate
from plop.pipeline.stage import Input, Output
from stages.report.stage import ReportConfig, run
from tests.report.report_inputs import DIAGNOSIS, law, visible, with_manifest
from tests.support.diagnoses import ranked

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-extensions",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
)
LONG = "base_with_a_name_of_many_parts_that_nobody_would_want_to_type_twice"
OPEN = {
    "traction_pa": Estimate(300.0, 184.0, 7890.0, "Pa", open=True),
    "release_s": Estimate(0.1, unit="s", alternatives=(0.03, 0.3), fitted=False, open=True),
}
WORSE = replace(
    DIAGNOSIS,
    ranking=(
        law("viscosity", 0.7, 0.005),
        ranked("adhesion", OPEN, gain=0.2, p=0.1, reasons=(Reason.CHANCE,)),
        *(law(name, -2.04, 1.0, Reason.NO_HELP, gain_error=3.1) for name in ("tilt", "fibres")),
        law("stiffness", -2.0, 1.0, Reason.NO_HELP, kind="base"),
    ),
)
KINDS = ("several", "one", "undiagnosed", "untested", "six")


def diagnosed(folder: Path, found: Diagnosis) -> Input:
    folder.mkdir()
    found.write(folder)
    return with_manifest(folder, "diagnose", "diag", model="model0")


@pytest.fixture(scope="module")
def pages(inputs, tmp_path_factory) -> dict[str, Path]:
    """Make one page of each kind of run."""
    folder = tmp_path_factory.mktemp("pages")
    two = {**inputs, "diagnoses.0": diagnosed(folder / "worse", WORSE)}
    every = replace(DIAGNOSIS, episodes=("box_000", "box_001"))
    alone = {name: inputs[name] for name in ("recordings", "init", "comparisons.0", "models.0")}
    six = {
        f"comparisons.{k}": with_manifest(
            inputs[f"comparisons.{k % 2}"].path, "compare", f"c{k}", recordings="rec", model=f"m{k}"
        )
        for k in range(6)
    }
    wanted = {
        "several": (two, ("base", LONG)),
        "one": ({**alone, "diagnoses.0": two["diagnoses.0"]}, ("base",)),
        "undiagnosed": (alone, ("base",)),
        "untested": ({**inputs, "diagnoses.0": diagnosed(folder / "every", every)}, ("base", "b")),
        "six": ({name: inputs[name] for name in ("recordings", "init")} | six, tuple("abcdef")),
    }
    assert tuple(wanted) == KINDS
    found = {}
    for name, (given, labels) in wanted.items():
        (folder / name).mkdir()
        run(given, ReportConfig(labels=labels, frames=2, episodes=1), Output(folder / name))
        found[name] = folder / name / "report.html"
    return found


def test_no_share_in_a_ranking_is_below_nothing(pages):
    said = visible(pages["several"])
    assert not re.search(r"[-−]\s?\d[\d.]*\s?%", said), "a negative percentage"
    assert "Does not help: tilt, fibres" in said and said.count("does not help") >= 3
    assert "± more than 100 %" not in said and "closes -" not in said


@pytest.mark.parametrize("kind", KINDS)
def test_every_table_and_chart_of_errors_shows_both_baselines(pages, kind):
    html = pages[kind].read_text()
    for chart in re.findall(r'<table class="bars">.*?</table>', html, re.S):
        assert "nothing moves" in chart and "best rigid motion (oracle)" in chart
    table = html.split("<h2>Before and after" if kind not in ("one", "undiagnosed") else "<h2>Episode by episode")[1]
    heads = re.findall(r"<th[^>]*>([^<]*)</th>", table.split("</thead>")[0])
    assert {"nothing moves", "best rigid motion (oracle)", "noise floor"} <= set(heads)
    assert len(re.findall(r'<table class="bars">', html)) == 4  # phase, distance, height, camera


def test_where_a_baseline_is_better_the_top_says_so_in_words(pages, inputs, tmp_path):
    """The second model here is better than both baselines, the first one too: then nothing is said."""
    assert 'id="beaten"' not in pages["several"].read_text()
    path = inputs["comparisons.0"].path / "compare.json"
    facts = json.loads(path.read_text())
    for row in facts["tables"]["episode"]:
        row["rigid_mm"], row["persistence_mm"] = 0.5 * row["rms_mm"], 2 * row["rms_mm"]
    (tmp_path / "c").mkdir()
    shutil.copytree(inputs["comparisons.0"].path, tmp_path / "c", dirs_exist_ok=True)
    (tmp_path / "c" / "compare.json").write_text(json.dumps(facts))
    beaten = with_manifest(tmp_path / "c", "compare", "cmp0", recordings="rec", model="model0")
    summary = run({**inputs, "comparisons.0": beaten}, ReportConfig(labels=("base", "b"), frames=2), Output(tmp_path))
    told = re.search(r'id="beaten">(.*?)</div>', (tmp_path / "report.html").read_text(), re.S)
    assert told and "Moving the object as one rigid body is closer to the measurement than base" in unescape(told[1])
    assert "than b:" not in told[1] and "nothing moves" not in told[1] and "oracle" in told[1]
    assert any("one rigid body" in warning for warning in summary.warnings)
    assert "a baseline is better than the model here" in visible(tmp_path / "report.html")


def test_what_is_not_determined_is_grey_and_says_so(pages):
    html = unescape(pages["several"].read_text())
    for start in ("traction_pa = 300", "release_s = 0.1"):
        [text] = re.findall(rf'<span class="open">({re.escape(start)}[^<]*)</span>', html)
        assert NOT_DETERMINED in text
    assert 'class="open">viscosity' not in html


@pytest.mark.parametrize("kind", KINDS)
def test_the_headline_is_one_sentence(pages, kind):
    [said] = re.findall(r'<p class="says">(.*?)</p>', pages[kind].read_text(), re.S)
    assert len(re.findall(r"[.!?](?=\s|$)", unescape(said))) == 1 and said.endswith(".")


@pytest.mark.parametrize("width", [390, 1400])
def test_nothing_is_wider_than_the_screen(pages, tmp_path, width):
    """Every page in a frame of that width (a headless window cannot be as narrow), asked for what sticks out."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here: no page was laid out (apt-get install chromium)")
    frames = "".join(
        f'<iframe id="{name}" width="{width}" height="900" style="border:0" '
        f'srcdoc="{escape(page.read_text())}"></iframe>'
        for name, page in pages.items()
    )
    (tmp_path / "frames.html").write_text(f"<!doctype html><body style='margin:0'>{frames}<script>{ASK}</script>")
    command = [
        CHROMIUM,
        *FLAGS,
        f"--user-data-dir={tmp_path / 'profile'}",
        "--window-size=1600,1000",
        "--virtual-time-budget=20000",
        "--dump-dom",
        (tmp_path / "frames.html").as_uri(),
    ]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False).stdout
    told = re.findall(r'<pre class="told">(.*?)</pre>', dom, re.S)
    found = {entry["name"]: entry for entry in (json.loads(unescape(text)) for text in told)}
    assert set(found) == set(pages), dom[-300:]
    for name, entry in found.items():
        assert entry["width"] <= width and entry["outside"] == [] and entry["drawn"] > 20, (name, entry)
        if width < 760:
            assert entry["small"] == [], (name, "too small for a finger", entry["small"])


ASK = """
onload = () => { for (const frame of document.querySelectorAll("iframe")) {
  const page = frame.contentDocument, width = frame.clientWidth, out = document.createElement("pre");
  for (const d of page.querySelectorAll("details")) d.open = true;
  const box = (e) => e.getBoundingClientRect(), shown = (e) => box(e).width > 0 && box(e).height > 0;
  const name = (e) => e.tagName + "." + e.className + " " + Math.round(box(e).right);
  const all = [...page.querySelectorAll("main *")].filter(shown);
  // on a narrow screen the rows are cards, so that nothing scrolls sideways
  const inside = (e) => width > 760 && e.closest(".wide") && !e.matches(".wide");
  out.className = "told";
  out.textContent = JSON.stringify({ name: frame.id, width: page.documentElement.scrollWidth, drawn: all.length,
    outside: all.filter((e) => !inside(e) && (box(e).right > width + 1 || box(e).left < -1)).map(name).slice(0, 9),
    small: [...page.querySelectorAll("button, select, input, summary")].filter((e) => shown(e) && box(e).height < 44)
      .map(name).slice(0, 9) });
  document.body.append(out);
} };
"""
