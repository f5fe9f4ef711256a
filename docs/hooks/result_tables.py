"""Tables of results from docs/results/*.json, each with the command, date, commit and machine that made it."""

from __future__ import annotations

import tables_parts
import tables_peers
import tables_physics
import tables_prediction
from result_files import Table, provenance

TABLES: dict[str, Table] = {
    **tables_prediction.TABLES,
    **tables_peers.TABLES,
    **tables_physics.TABLES,
    **tables_parts.TABLES,
}
"""Name in `[[table NAME]]` -> what makes the table, and the files that it shows."""


def table(name: str) -> str:
    """Return a table with its provenance below."""
    made, sources = TABLES[name]
    notes = []
    for source in sources:
        facts = provenance(source)
        notes.append(f"`{facts['command']}`, {facts['date']}, commit {facts['commit']}, {facts['machine']}")
    return f"{made()}\n\n*{'; '.join(dict.fromkeys(notes))}.*{{ .made }}"
