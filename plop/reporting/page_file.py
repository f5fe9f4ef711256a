"""One self-contained page: styles, scripts, pictures and numbers inside, no request to anywhere.

The templates in `page/` hold all HTML; Jinja2 escapes whatever they insert. Python makes the typed values.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from plop.diagnosis.decision.finding import NO_HELP, explained_text
from plop.parameters import NOT_DETERMINED, alternatives_text, short_number, with_unit
from plop.reporting.baselines import BASELINES, ORACLE
from plop.reporting.colours import PHASE_COLOURS, colour_map
from plop.reporting.compared import ReportFacts
from plop.reporting.diagnosis_section import diagnosis_section
from plop.reporting.error_section import before_after_section, where_section
from plop.reporting.numbers import number, percent, short, unbroken
from plop.reporting.packed import STEP_MM
from plop.reporting.parameters_section import parameters_section
from plop.reporting.provenance_section import provenance_section
from plop.reporting.report_images import difference_palette
from plop.reporting.verdict_section import gap_text, verdict_section
from plop.tracking.phases import PHASES

if TYPE_CHECKING:
    from jinja2 import Environment


@dataclass(frozen=True)
class Look:
    """What the pictures of the episodes stand among."""

    episodes: list[str]
    phases: list[tuple[str, str]]
    """Those that occur, with their colours."""
    limit_mm: float
    difference: list[tuple[int, int, int]]
    """Colours of a depth difference, predicted nearer first."""
    errors: list[str]
    """Colours of an error, small ones first."""


def report_page(facts: ReportFacts, episodes: list[dict[str, Any]], *, limit_mm: float) -> str:
    """Write the page.

    Args:
        facts: What the sections say.
        episodes: Packed episodes with their images (plop.reporting.packed, plop.reporting.report_images).
        limit_mm: Depth difference at the ends of the colour scale [mm].

    Returns:
        HTML.
    """
    data = {
        "episodes": episodes,
        "models": [{"label": c.label, "colour": c.colour} for c in facts.compared],
        "palette": colour_map(32),
        "phase_colours": PHASE_COLOURS,
        "step_mm": STEP_MM,
    }
    return render(
        "page.html",
        facts=facts,
        data=data,
        verdict=verdict_section(facts),
        look=_look(episodes, limit_mm),
        charts=where_section(facts),
        episodes=before_after_section(facts),
        diagnoses=[diagnosis_section(label, found) for label, found in facts.diagnoses],
        parameters=parameters_section(facts),
        provenance=provenance_section(facts),
    )


def render(template: str, **context: Any) -> str:
    """Fill in one template of `page/`; everything inserted is escaped."""
    return _environment().get_template(template).render(context)


@lru_cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # only when a page is written
    from markupsafe import Markup

    loader = PackageLoader("plop.reporting", "page")
    made = Environment(autoescape=True, loader=loader, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    made.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    made.filters |= {
        "gap": gap_text,
        "number": number,
        "percent": percent,
        "settings": lambda config: json.dumps(config, indent=1, sort_keys=True),
        "short": short,
        "short_number": short_number,
        "unbroken": unbroken,
    }
    made.globals |= {
        "BASELINES": BASELINES,
        "NO_HELP": NO_HELP,
        "NOT_DETERMINED": NOT_DETERMINED,
        "ORACLE": ORACLE,
        "alternatives_text": alternatives_text,
        "asset": lambda name: Markup(loader.get_source(made, name)[0]),  # our own styles and scripts, not data
        "explained_text": explained_text,
        "with_unit": with_unit,
    }
    return made


def _look(episodes: list[dict[str, Any]], limit_mm: float) -> Look:
    seen = {name for e in episodes for _, _, name in e["phases"]}
    return Look(
        [e["name"] for e in episodes],
        [(name, PHASE_COLOURS[name]) for name in PHASES if name in seen],
        limit_mm,
        list(difference_palette()[::4]),
        colour_map(16),
    )
