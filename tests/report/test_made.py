"""Provenance: everything that a report was made from, in the order in which it can be made again."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.manifest import Manifest, write_manifest
from plop.pipeline.stage import Input
from plop.reporting.compared import ReportFacts
from plop.reporting.page_file import render
from plop.reporting.provenance_section import provenance_section
from stages.report.made import ON_THE_WAY, provenance


def artifact(folder: Path, stage: str, mark: str, config: dict, *, kept: bool = True, **made_from: Manifest) -> Input:
    inputs = {name: {"stage": m.stage, "fingerprint": m.fingerprint, "content": "0"} for name, m in made_from.items()}
    if stage == "simulate":
        inputs["scene"] = {"name": "block.toml", "content": "0"}
    manifest = Manifest(stage, mark * 16, 1, config, inputs, provenance={"command": stage})
    path = folder / stage / manifest.fingerprint
    if kept:
        path.mkdir(parents=True)
        write_manifest(path, manifest)
    return Input(path, manifest)


def test_what_was_made_on_the_way_is_listed_before_what_needs_it(tmp_path):
    films = artifact(tmp_path, "simulate", "a", {"seed": 200, "episodes": 6, "snr": 0.0, "test": ["*_004", "*_005"]})
    gone = artifact(tmp_path, "fuse", "b", {}, kept=False, recordings=films.manifest)
    init = artifact(tmp_path, "fit-init", "c", {"steps": 500}, recordings=films.manifest, cloud=gone.manifest)
    found = artifact(tmp_path, "diagnose", "d", {"seed": 0}, recordings=films.manifest, init=init.manifest)
    made = provenance({"diagnoses.0": found, "recordings": films})
    assert [m.address.partition("@")[0] for m in made] == ["simulate", "fit-init", "diagnose"]
    assert [m.role for m in made] == ["recordings", ON_THE_WAY, "diagnoses"]
    assert made[0].settings == {"seed": 200, "episodes": 6, "test": ["*_004", "*_005"]} and made[2].settings == {}
    page = render("provenance.html", provenance=provenance_section(ReportFacts("t", [], provenance=made)))
    assert "plop simulate block.toml --set seed=200 --set episodes=6 --set &#39;test=[&#34;*_004&#34;" in page
    assert "--recordings simulate@aaaaaaaa" in page and "--set steps=500" in page
