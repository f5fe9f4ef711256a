"""The benchmark of the verdict's tests counts what it says, and its tables hold every row."""

from __future__ import annotations

from benchmarks.verdict_chances import (
    HELD,
    SCATTERS,
    contrast_rows,
    contrast_table,
    limit_rows,
    limit_table,
    null_rows,
    null_table,
)


def test_every_case_of_the_contrast_is_a_row():
    rows = list(contrast_rows(6))
    assert len(rows) == 2 * len(SCATTERS) * len(HELD) and {row["held"] for row in rows} == set(HELD)
    assert all(row["false_1"]["n"] == 6 and row["seen"]["n"] == 2 for row in rows)
    assert len(contrast_table(rows).splitlines()) == 2 + len(rows)


def test_what_is_hidden_at_its_limit_is_counted_apart_from_half_of_it():
    rows = list(limit_rows(1))
    assert len(rows) == 4 and all(row["at"]["n"] == row["half"]["n"] == 3 for row in rows)
    assert sum(row["at"]["rate"] for row in rows) > sum(row["half"]["rate"] for row in rows)
    assert len(limit_table(rows).splitlines()) == 2 + len(rows)


def test_nothing_hidden_is_counted_with_and_without_a_reference():
    rows = list(null_rows(2))
    assert [row["reference"] for row in rows].count(True) == 6 and {row["named"]["n"] for row in rows} == {2}
    assert len(null_table(rows).splitlines()) == 2 + len(rows)
