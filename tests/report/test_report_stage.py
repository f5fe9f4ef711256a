"""The report: what the page says, that nothing leaves it, and that it works in a real browser."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

from plop.comparison.result import Comparison
from plop.dynamics.i2n.model_io import MODEL_SCHEMA
from plop.errors import PlopError
from plop.pipeline.stage import Input, Output
from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.page_file import report_page
from stages.report.stage import ReportConfig, check_inputs, run
from tests.report.report_inputs import DIAGNOSIS, NASTY, law, visible, with_manifest
from tests.support.diagnoses import verdict

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="module")
def page(inputs, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    summary = run(inputs, ReportConfig(labels=("base", f"base+{NASTY}")), Output(folder))
    assert summary.figures["verdict"] == "EFFECT" and summary.table[1]["way_to_floor_percent"] > 75
    return folder / "report.html"


def test_the_page_says_what_was_found(page):
    said = visible(page)
    assert said.index("EFFECT") < said.index("Measured, predicted, difference") < said.index("Ranking")
    for words in (
        "What base is missing is viscosity",
        "70.0 ± 5.0 %",
        "p = 0.400 > 0.01",
        "viscosity_pa_s",
        "36 to 44",
        "Pa s",
        "traction_pa 12 Pa",
        "held out",
        "by phase",
        "by distance to the tool",
        "by camera",
        "nothing moves",
        "plop compare --recordings x@rec",
        "compare@cmp1",
        "seed",
    ):
        assert words in said, words


def test_an_effect_is_not_described_twice(page):
    """The verdict's own sentence says again what headline and ranking say."""
    assert "Missing: viscosity" not in visible(page)


def test_markup_in_names_is_escaped(inputs):
    """Of an episode, a camera, a model, and in the title."""
    errors = Comparison.load(inputs["comparisons.0"].path)
    episodes = tuple(replace(row, labels={"episode": NASTY}) for row in errors.tables.episode)
    cameras = tuple(replace(row, camera=NASTY) for row in errors.tables.camera)
    errors = replace(errors, tables=replace(errors.tables, episode=episodes, camera=cameras))
    nasty = Compared(NASTY, "#000000", errors)
    episode = {"name": NASTY, "phases": [[0.0, 1.0, "contact"]], "images": {"camera": NASTY}}
    html = report_page(ReportFacts(NASTY, [nasty], recordings=NASTY), [episode], limit_mm=5.0)
    assert "<script>alert" not in html
    assert '<option value="0">&lt;script&gt;alert(1)&lt;/script&gt;</option>' in html
    for tag in ('<td data-head="episode">', 'scope="rowgroup">', 'data-model="0">', "<h1>"):
        assert f"{tag}&lt;script&gt;alert(1)&lt;/script&gt;<" in html, tag


def test_only_the_first_of_several_reasons_is_written_out(page):
    html = page.read_text()
    assert "<details><summary>no: p = 0.400 &gt; 0.01, and 1 more</summary>only one episode shows it</details>" in html


def test_episodes_that_were_fitted_to_are_not_called_held_out(page):
    rows = re.findall(r'<td data-head="episode">(box_00\d)</td>\s*<td[^>]*>([^<]*)</td>', page.read_text())
    assert ("box_000", "fitted to") in rows and ("box_001", "held out") in rows


def test_nothing_is_called_held_out_when_the_fit_is_not_known(inputs, tmp_path):
    unknown = {name: value for name, value in inputs.items() if not name.startswith("diagnoses")}
    summary = run(unknown, ReportConfig(frames=2), Output(tmp_path))
    assert {row["over"] for row in summary.table} == {"all episodes"}
    table = visible(tmp_path / "report.html").split("Before and after")[1].split("Parameters")[0]
    assert "held out" not in table and "Gap closed: the share" in table and "gap closed" in table


def test_the_page_says_which_episodes_were_held_out_of_the_fit(page, inputs, tmp_path):
    assert "Held out of every fit: box_001; fitted to: box_000." in visible(page)
    replace(DIAGNOSIS, episodes=("box_000", "box_001")).write(tmp_path)
    every = with_manifest(tmp_path, "diagnose", "diag", model="model0")
    summary = run({**inputs, "diagnoses.0": every}, ReportConfig(frames=2), Output(tmp_path))
    assert {row["over"] for row in summary.table} == {"all episodes, none held out"}
    said = visible(tmp_path / "report.html")
    assert "None of these episodes was held out: all of them took part in a fit" in said and "Held out of" not in said


def test_what_the_base_was_fitted_to_is_not_held_out(inputs, tmp_path):
    (tmp_path / "model.json").write_text(
        json.dumps({"schema": MODEL_SCHEMA, "kind": "engine", "training": {"episodes": ["box_001"]}})
    )
    for source, over in (("rec", "all episodes, none held out"), ("other", "held-out episodes")):
        base = with_manifest(tmp_path, "identify", "model0", recordings=source)
        summary = run({**inputs, "models.0": base}, ReportConfig(frames=2), Output(tmp_path))
        assert {row["over"] for row in summary.table} == {over}


def test_a_base_parameter_is_reported_with_its_own_share(inputs, tmp_path):
    base = law("stiffness", 0.6, 0.005, kind="base")
    for named in ((), ("stiffness",)):
        said = verdict("BASE PARAMETER" if named else "NONE OF THESE", *named)
        replace(DIAGNOSIS, verdict=said, ranking=(*DIAGNOSIS.ranking[:2], base)).write(tmp_path)
        given = with_manifest(tmp_path, "diagnose", "diag", model="model0")
        run({**inputs, "diagnoses.0": given}, ReportConfig(frames=2), Output(tmp_path))
        said = visible(tmp_path / "report.html")
        assert ("60.0 ± 5.0 % of the held-out error explained by stiffness" in said) == bool(named)


def test_sensors_that_were_not_looked_for_are_not_called_sound(page, inputs, tmp_path):
    assert "No sensor fault was found." in visible(page)
    replace(DIAGNOSIS, sensors=None).write(tmp_path)
    blind = Input(tmp_path, inputs["diagnoses.0"].manifest)
    run({**inputs, "diagnoses.0": blind}, ReportConfig(frames=2), Output(tmp_path))
    said = visible(tmp_path / "report.html")
    assert "Sensor faults were not looked for." in said and "No sensor fault" not in said


def test_the_commands_to_repeat_it_end_with_the_report_itself(page):
    commands = re.search(r'<pre class="commands">(.*?)</pre>', page.read_text(), re.S)
    last = unescape(re.findall("<code>(.*?)</code>", commands[1])[-1])
    assert last.startswith("plop report --recordings simulate@rec --init fit-init@ini")
    for part in (
        "--comparisons compare@cmp0,compare@cmp1",
        "--models augment@model0,augment@model1",
        "--evals none",
        "--diagnoses diagnose@diag",
        '--set \'labels=["base"',
        "# this report",
    ):
        assert part in last, part


@pytest.mark.parametrize("change", [{"comparisons.1": ("compare", "model0")}, {"diagnoses.0": ("diagnose", "model9")}])
def test_one_model_twice_and_a_diagnosis_of_another_are_refused(inputs, tmp_path, change):
    [(name, (stage, model))] = change.items()
    other = with_manifest(inputs[name].path, stage, "x", recordings="rec", model=model)
    with pytest.raises(PlopError, match=r"compared twice|not in the report") as caught:
        run({**inputs, name: other}, ReportConfig(), Output(tmp_path))
    assert caught.value.fix


def test_nothing_can_leave_the_page(page):
    html = page.read_text()
    assert "Content-Security-Policy" in html and "default-src 'none'" in html
    assert not re.search(r"""(src|href|action)\s*=\s*["']?\s*(https?:)?//""", html)
    assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|sendBeacon|import)\s*\(", html)
    assert not re.search(r"url\(\s*['\"]?(?!data:)", html) and "@import" not in html
    assert NASTY not in html.split("<script type=")[0], "names must be escaped"
    assert page.stat().st_size < 3e6


def test_in_a_browser_it_renders_the_scrubber_moves_and_nothing_is_requested(page, tmp_path):
    if CHROMIUM is None:
        pytest.skip("no Chromium here: the page was not opened in a browser (apt-get install chromium)")
    found, dom = None, ""
    for budget_ms in (10_000, 100_000, 1_000_000):  # virtual time does not wait for pictures that are being decoded
        command = [
            CHROMIUM,
            *FLAGS,
            f"--user-data-dir={tmp_path / 'profile'}",
            "--window-size=1280,900",
            f"--virtual-time-budget={budget_ms}",
            "--dump-dom",
            f"{page.as_uri()}#selftest",
        ]
        dom = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False).stdout
        found = re.search(r'<pre id="selftest">(.*?)</pre>', dom, re.S)
        if found:
            break
    assert found, f"the page did not finish its self-test: {dom[-400:]}"
    told = json.loads(unescape(found[1]))
    assert told.pop("errors") == [] and told.pop("requests") == [] and told.pop("overflows") is False
    assert told.pop("widths") == [48, 48, 48]
    assert all(told.values()), told


def test_results_of_other_recordings_are_refused(inputs, tmp_path):
    other = with_manifest(inputs["comparisons.1"].path, "compare", "cmp9", recordings="other", model="model1")
    with pytest.raises(PlopError, match="different recordings"):
        run({**inputs, "comparisons.1": other}, ReportConfig(), Output(tmp_path))


@pytest.mark.parametrize("config", [ReportConfig(labels=("one",)), ReportConfig(labels=("a", "a"))])
def test_settings_without_sense_are_named(inputs, tmp_path, config):
    with pytest.raises(PlopError) as caught:
        run(inputs, config, Output(tmp_path))
    assert caught.value.where.startswith("report.")
    assert not list(tmp_path.iterdir())


def test_a_report_without_diagnosis_says_where_it_fails(inputs, tmp_path):
    alone = {name: inputs[name] for name in ("recordings", "init", "comparisons.0")}
    summary = run(alone, ReportConfig(frames=2), Output(tmp_path))
    said = visible(tmp_path / "report.html")
    assert "NOT DIAGNOSED" in said and "most in episode box_00" in said and summary.figures["models"] == 1


def test_a_camera_that_is_not_there_is_refused_before_anything_else(inputs, tmp_path):
    """With the recordings alone, as before models are compared."""
    with pytest.raises(PlopError, match="no such camera") as caught:
        check_inputs({"recordings": inputs["recordings"]}, ReportConfig(camera="cam_99"))
    assert "cam_00" in caught.value.expected and caught.value.found == "cam_99"
    check_inputs({"recordings": inputs["recordings"]}, ReportConfig(camera="cam_00"))


@pytest.mark.parametrize("content", ["{", "[]", '{"schema": 8}', '{"schema": 2, "verdict": {"kind": "EFFECT"}}'])
def test_a_diagnosis_that_cannot_be_read_is_refused_with_its_place(inputs, tmp_path, content):
    (tmp_path / "diagnosis.json").write_text(content)
    with pytest.raises(PlopError) as caught:
        run(
            {**inputs, "diagnoses.0": with_manifest(tmp_path, "diagnose", "d", model="model0")},
            ReportConfig(),
            Output(tmp_path),
        )
    assert "diagnosis.json" in caught.value.where and "plop diagnose" in caught.value.fix


@pytest.mark.parametrize("content", ["{", '{"estimates": {"youngs_modulus_pa": {"low": 3}}}', '{"effects": [{}]}'])
def test_a_model_that_cannot_be_read_is_refused_with_its_place(inputs, tmp_path, content):
    (tmp_path / "model.json").write_text(content)
    with pytest.raises(PlopError) as caught:
        run({**inputs, "models.0": with_manifest(tmp_path, "identify", "model0")}, ReportConfig(), Output(tmp_path))
    assert "model.json" in caught.value.where and caught.value.fix
