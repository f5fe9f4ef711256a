"""Where the inputs of a report came from, with everything that they were made from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from plop.artifacts.fingerprint import flat_values, plain
from plop.artifacts.lineage import LEFT_OUT
from plop.artifacts.manifest import Manifest, read_manifest
from plop.errors import PlopError
from plop.pipeline.registry import stage_ref
from plop.pipeline.stage import Inputs
from plop.reporting.compared import Made

ON_THE_WAY = "intermediate"
"""What an artifact is that no input of the report is, but that one was made from."""


def provenance(inputs: Inputs) -> list[Made]:
    """Say of every input, and of all that it was made from, where it came from; each after what it needs.

    What an input was made from is looked for beside it, as a workspace keeps it; what is not there any more is left
    out.
    """
    roles = {item.manifest.address: name.partition(".")[0] for name, item in inputs.items() if item.manifest}
    found: dict[str, Made] = {}
    for item in inputs.values():
        if item.manifest is not None:
            _add(found, item.manifest, item.path, roles)
    return list(found.values())


def this_report(inputs: Inputs, config: dict[str, Any]) -> Made | None:
    """Say how the report itself is made again from the same inputs; None where one of them has no address.

    An optional input that it had not is named as left out: else the latest that fits would be taken.
    """
    given: dict[str, list[str]] = {}
    for name, item in inputs.items():
        if item.manifest is None:
            return None
        given.setdefault(name.partition(".")[0], []).append(item.manifest.address)
    absent = {
        name: [LEFT_OUT]
        for name, spec in stage_ref("report").load().inputs.items()
        if spec.optional and name not in given
    }
    sources = {name: ",".join(addresses) for name, addresses in (given | absent).items()}
    config = json.loads(json.dumps(config))
    return Made("this report", "report", "report", config, sources, {}, "", None, "", _settings("report", config))


def _add(found: dict[str, Made], manifest: Manifest, path: Path, roles: dict[str, str]) -> None:
    if manifest.address in found:
        return
    for source in manifest.inputs.values():
        if "fingerprint" in source:
            folder = path.parent.parent / source["stage"] / source["fingerprint"]
            try:
                _add(found, read_manifest(folder), folder, roles)
            except PlopError:
                continue
    found[manifest.address] = _made(manifest, roles.get(manifest.address, ON_THE_WAY))


def _made(manifest: Manifest, role: str) -> Made:
    sources = {
        name: f"{s['stage']}@{s['fingerprint'][:8]}" if "fingerprint" in s else str(s.get("name", "a file"))
        for name, s in manifest.inputs.items()
    }
    known = manifest.provenance
    command = str(known.get("command", manifest.stage))
    return Made(
        manifest.address,
        role,
        command,
        manifest.config,
        sources,
        {k: str(v) for k, v in known.get("versions", {}).items()},
        str(known.get("made", "")),
        known.get("seconds"),
        manifest.fingerprint,
        _settings(command, manifest.config),
    )


def _settings(command: str, config: dict[str, Any]) -> dict[str, Any]:
    """Give the settings that are not a stage's defaults, nested ones as `outer.inner`; all of an unknown stage."""
    given = dict(flat_values(config))
    try:
        defaults = dict(flat_values(plain(stage_ref(command).load().config())))
    except KeyError:
        return given
    return {key: value for key, value in given.items() if key not in defaults or value != defaults[key]}
