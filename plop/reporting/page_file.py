"""One self-contained page: styles, scripts, pictures and numbers inside, no request to anywhere."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plop.reporting.baselines import BASELINES
from plop.reporting.colours import PHASE_COLOURS, colour_map
from plop.reporting.compared import ReportFacts
from plop.reporting.diagnosis_section import diagnosis_sections
from plop.reporting.error_section import before_after_section, where_section
from plop.reporting.html import text
from plop.reporting.packed import STEP_MM
from plop.reporting.parameters_section import parameters_section
from plop.reporting.provenance_section import provenance_section
from plop.reporting.report_images import difference_palette
from plop.reporting.verdict_section import verdict_section
from plop.tracking.phases import PHASES

_PARTS = Path(__file__).parent / "page"
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


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
    # "</" would end the script element wherever it stands.
    packed = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    style, solid, page = ((_PARTS / name).read_text() for name in ("page.css", "solid.js", "page.js"))
    parts = [
        verdict_section(facts),
        _look_section(facts, episodes, limit_mm),
        where_section(facts),
        before_after_section(facts),
        diagnosis_sections(facts),
        parameters_section(facts),
        provenance_section(facts),
    ]
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{text(facts.title)}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{style}</style></head>'
        f"<body><main><h1>{text(facts.title)}</h1><p class='soft'>{_subtitle(facts)}</p>{''.join(parts)}</main>"
        f'<script type="application/json" id="data">{packed}</script><script>{solid}</script>'
        f"<script>{page}</script></body></html>\n"
    )


def _subtitle(facts: ReportFacts) -> str:
    count = len(facts.compared[0].episodes)
    models = ", ".join(text(c.label) for c in facts.compared)
    return f"Models: {models}. Recordings: {text(facts.recordings)}, {count} episodes."


def _look_section(facts: ReportFacts, episodes: list[dict[str, Any]], limit_mm: float) -> str:
    if not episodes:
        return ""
    held = set(facts.held_out)
    options = "".join(
        f'<option value="{k}">{text(e["name"])}{" (held out)" if e["name"] in held else ""}</option>'
        for k, e in enumerate(episodes)
    )
    models = "".join(
        f'<button type="button" data-model="{k}">{text(c.label)}</button>' for k, c in enumerate(facts.compared)
    )
    seen = {name for e in episodes for _, _, name in e["phases"]}
    phases = "".join(
        f'<span><i class="swatch" style="background:{PHASE_COLOURS[name]}"></i>{name}</span>'
        for name in PHASES
        if name in seen
    )
    lines = "".join(
        f'<span><i style="border-top:3px solid {c.colour}"></i>{text(c.label)}</span>' for c in facts.compared
    )
    baselines = "".join(
        f'<span><i style="border-top:2px dashed {b.colour}"></i>{text(b.label)}</span>' for b in BASELINES
    )
    return f"""<h2>Measured, predicted, difference</h2>
<div class="controls"><label for="episode">Episode</label><select id="episode">{options}</select>
<span role="group" aria-label="model" class="controls" style="margin:0"><span class="label">Model</span>{models}</span>
</div>
<div class="scrub"><button type="button" id="play">Play</button>
<input type="range" id="scrub" min="0" max="1" step="1" value="0" aria-label="time"><output id="now"></output></div>
<div class="triple">
<figure><img id="measured" alt="measured image">
<figcaption>measured, camera <span id="camera"></span></figcaption></figure>
<figure><img id="predicted" alt="predicted image"><figcaption id="predicted-caption">predicted</figcaption></figure>
<figure><img id="difference" alt="difference in depth">
<figcaption>difference in depth, predicted minus measured</figcaption>
<div class="bar" style="background:{_gradient(difference_palette())}"></div>
<div class="ticks"><span>{limit_mm:g} mm nearer</span><span>0</span><span>{limit_mm:g} mm farther</span></div>
<p class="key"><span><i style="height:11px;background:rgb(20,20,20)"></i>only measured</span>
<span><i style="height:11px;background:rgb(120,120,120)"></i>only predicted</span>
<span><i style="height:11px;background:rgb(190,194,199)"></i>tool</span></p></figure></div>
<div class="pair"><figure><div class="controls"><span role="group" aria-label="shape" class="controls" style="margin:0">
<span class="label">Error on the object, shape as</span><button type="button" data-shape="measured">measured</button>
<button type="button" data-shape="predicted">predicted</button></span></div>
<canvas id="solid" tabindex="0" role="img"
aria-label="error on the object; arrow keys turn it, plus and minus zoom"></canvas>
<div class="bar" style="background:linear-gradient(90deg,{",".join(colour_map(16))})"></div>
<div class="ticks"><span>0 mm</span><span id="bar-middle"></span><span id="bar-top"></span></div>
<figcaption>Drag to turn; click and scroll to zoom; or arrow keys, + and −.</figcaption></figure>
<figure><div class="controls"><span class="label">Error over time</span></div>
<canvas id="chart" role="img" aria-label="error over time"></canvas>
<p class="key">{lines}{baselines}
<span><i style="border-top:2px dotted #000"></i>noise floor</span></p><p class="key">{phases}</p></figure></div>"""


def _gradient(colours: Sequence[tuple[int, int, int]]) -> str:
    return "linear-gradient(90deg," + ",".join(f"rgb({r},{g},{b})" for r, g, b in colours[::4]) + ")"
