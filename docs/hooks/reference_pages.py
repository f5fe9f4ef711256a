"""Reference pages generated from the code: commands, settings, effects, API; and blocks for written pages."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import file_layouts
from markdown_parts import code, escaped, rows

# --- commands -------------------------------------------------------------------------------------------------------


def _command(ref: Any) -> Any:
    import typer

    from plop_cli.stage_command import stage_app

    return typer.main.get_command(stage_app(ref))


def _usage(name: str, command: Any) -> str:
    arguments = [p.metavar or p.name.upper() for p in command.params if p.param_type_name == "argument"]
    return f"```\nplop {' '.join([name, *arguments, '[OPTIONS]'])}\n```"


def _plain(text: str | None) -> str:
    """Remove the escapes that rich needs."""
    return escaped((text or "").replace("\\[", "[").replace("\n", " ").strip())


def _options(command: Any, panels: Callable[[str], bool]) -> str:
    lines = []
    for parameter in command.params:
        panel = getattr(parameter, "rich_help_panel", None) or ""
        if not panels(panel) or getattr(parameter, "hidden", False):
            continue
        names = (
            parameter.opts if parameter.param_type_name == "option" else [parameter.metavar or parameter.name.upper()]
        )
        default = getattr(parameter, "show_default", None)
        lines.append(
            (code(", ".join(names)), _plain(parameter.help), escaped(default) if isinstance(default, str) else "")
        )
    if not any(default for *_, default in lines):
        return rows(["option", "meaning"], (line[:2] for line in lines)) if lines else ""
    return rows(["option", "meaning", "default"], lines)


def commands_page() -> str:
    """List all commands with their inputs and options; the settings of stages have a page of their own."""
    import typer

    from plop.pipeline.registry import pipeline
    from plop_cli.app import app

    stages = {ref.command: _command(ref) for ref in pipeline()}
    root: Any = typer.main.get_command(app)
    others = {n: c for n, c in root.commands.items() if n not in {ref.command.split()[0] for ref in pipeline()}}
    first = next(iter(stages.values()))
    parts = [
        "# Commands",
        "`plop --help` lists them, `plop COMMAND --help` shows every option.",
        "## Common options of all stages",
    ]
    parts += ["Each stage accepts these, besides its inputs (below) and its [settings](settings.md).", ""]
    parts += [_options(first, lambda panel: panel == "Running")]
    for name, command in stages.items():
        parts += [f"## {name}", _plain(command.help), _usage(name, command)]
        parts += [_options(command, lambda panel: panel not in ("Running", "Settings")) or "It has no inputs."]
        parts += [f"[Settings](settings.md#{_slug(name)}), [what it writes](outputs.md#{_slug(name.split()[0])})."]
    for name, command in others.items():
        text = inspect.cleandoc(command.help or "").replace("\b", "")
        parts += [f"## {name}", _plain(text), _usage(name, command), _options(command, lambda panel: True)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _slug(name: str) -> str:
    return name.replace(" ", "-")


# --- settings -------------------------------------------------------------------------------------------------------


def settings_page() -> str:
    """List every setting of every stage as plop.toml takes it."""
    from plop.pipeline.settings_reference import settings_reference

    parts = [
        "# Settings",
        "Each is a key of `plop.toml` in the workspace, below `[STAGE]`; an option of the stage's command, "
        "`--KEY VALUE` with `-` for `_`; and `--set KEY=VALUE`. [Which one wins](../how-to/change-settings.md).",
    ]
    for command, tables in settings_reference().items():
        parts += [f"## {command}", tables.strip()]
    return "\n\n".join(parts) + "\n"


# --- effects --------------------------------------------------------------------------------------------------------


def effects_page() -> str:
    """List the laws of the library and the sensor faults."""
    from plop.physics.effects.library import library
    from plop.sensors.faults.library import ALL_FAULTS

    parts = [
        "# Effects and sensor faults",
        "What an effect is, and how to write one: [Write an effect](../how-to/write-an-effect.md). In the laws, "
        "tau is the Kirchhoff stress, F the deformation gradient, L the velocity gradient, mu the shear modulus of the "
        "base, E its Young's modulus.",
        "- **physics**: what a diagnosis may name.\n"
        "- **base**: a parameter that every model has; it is refitted beside an effect and named as such.\n"
        "- **decoy**: a law that slow motion does not show. A method that names a decoy is wrong.",
    ]
    for name, effect in library().items():
        lines = [
            (code(p.name), p.unit, f"{p.low:g} to {p.high:g}", _amounts(p), escaped(p.help))
            for p in effect.parameters()
        ]
        parts += [
            f"## {name}",
            f"{escaped(effect.help)} (*{effect.kind}*)",
            f"```\n{effect.law}\n```",
            rows(["parameter", "unit", "range", "tried at", "meaning"], lines),
            f"{_settings_tried(effect)}Source: {escaped(effect.source)}.",
        ]
    parts.append(
        "## Sensor faults\n\nWritten as `--fault NAME[.PARAMETER]=VALUE[@CAMERA]`; without a parameter the first "
        "is used, without a camera the first one; `@*` means all cameras. Those of the tool have no camera."
    )
    lines = [
        (
            code(name),
            escaped(fault.help),
            code(fault.law),
            ", ".join(f"`{p.name}` [{p.unit}]" for p in fault.parameters),
        )
        for name, fault in ALL_FAULTS.items()
    ]
    parts.append(rows(["fault", "what it is", "law", "parameters"], lines))
    return "\n\n".join(parts) + "\n"


def _settings_tried(effect: Any) -> str:
    """Return the settings of shape parameters at which a diagnosis tries a law."""
    tried = [", ".join(f"`{key}` {value:g}" for key, value in each.items()) for each in effect.variants if each]
    return f"A diagnosis tries {'; '.join(tried)}.\n\n" if tried else ""


def _amounts(parameter: Any) -> str:
    """Return typical and tried amplitudes; a shape parameter has a default instead."""
    if not parameter.typical:
        return f"else {parameter.default:g}"
    return ", ".join(f"{value:g}" for value in (parameter.typical, *parameter.tried))


# --- API, formats, scores -------------------------------------------------------------------------------------------


def api_page() -> str:
    """Document every public name with mkdocstrings, under the name by which it is imported."""
    import plop

    parts = [
        "# Python API",
        "`import plop` provides these names, imported on first use; [how they work together](../how-to/python.md). "
        "Everything else may change between versions.",
    ]
    for name in plop.__all__:
        found = getattr(plop, name)
        options = {"show_root_heading": "true", "heading": f"plop.{name}", "toc_label": f"plop.{name}"}
        lines = "".join(f"\n      {key}: {value}" for key, value in options.items())
        parts.append(f"[](){{ #plop.{name} }}\n\n::: {found.__module__}.{found.__qualname__}\n    options:{lines}")
    return "\n\n".join(parts) + "\n"


def scores_block() -> str:
    """List the scores with their conventions."""
    from plop.metrics.frame import CONVENTIONS

    return rows(["score", "convention"], ((code(key), escaped(text)) for key, text in CONVENTIONS.items()))


def formats_block() -> str:
    """List the formats that `plop ingest` recognises and does not read."""
    from plop.recordings.readers.formats import FORMATS

    lines = [
        (form.name, code(f"plop ingest {form.nearest}"), escaped(form.advice)) for form in FORMATS if not form.reader
    ]
    return rows(["format", "nearest reader", "what to do"], lines)


PAGES: dict[str, Callable[[], str]] = {
    "reference/commands.md": commands_page,
    "reference/settings.md": settings_page,
    "reference/effects.md": effects_page,
    "reference/api.md": api_page,
}
"""Place in docs/ -> what makes the page."""
BLOCKS: dict[str, Callable[[], str]] = {"scores": scores_block, "formats": formats_block, **file_layouts.BLOCKS}
"""Name in `[[code NAME]]` -> what makes the block."""
