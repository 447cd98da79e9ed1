"""Cells as people read them, and as programs do: nothing is lost on the way through CSV."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.tables.canvas import empty_picture
from hilbertvae.tables.page import (
    Page,
    Table,
    hidden,
    markdown_of,
    measured,
    megabytes,
    number,
    printed_percent,
    signed_points,
    text,
    value,
)
from hilbertvae.tables.spread import Spread
from toy_sweeps import rows_of_csv

COLUMNS = [text("who", "who"), hidden("status"), value("size (m)", "size_m"), measured("P / R (%)", "p", "r"), text("note", "note")]
finite = st.floats(-1e9, 1e9)


def test_markdown():
    rows = [
        {"who": "a|b", "size_m": 2.5, "p": Spread(0.5, 0.1, 3), "r": Spread(0.25, None, 1), "note": "two\nlines"},
        {"who": "c", "p": "failed"},
        {"who": "d"},
    ]
    lines = markdown_of(Table("table", rows, COLUMNS)).splitlines()
    assert lines[0] == "| who | size (m) | P / R (%) | note |" and lines[1] == "| --- | ---: | ---: | --- |"
    assert lines[2] == r"| a\|b | 2.5 | 50.0±10.0 / 25.0 | two lines |"
    assert lines[3] == "| c | - | failed / - | - |" and lines[4] == "| d | - | - | - |"
    assert markdown_of(Table("table", [], COLUMNS)) == ""


@pytest.mark.parametrize(
    ("mean", "sd", "expected"),
    [
        (0, None, "0"), (0.0, 0.1, "0.00±0.10"), (5, None, "5"), (1234.5, None, "1234"), (1234.5, 20.25, "1234±20"),
        (0.03541, 0.0045, "0.0354±0.0045"), (1.5, None, "1.50"), (12.34, 0.5, "12.3±0.5"), (9.999, 0.1, "10.00±0.10"),
    ],
)  # fmt: skip
def test_number(mean, sd, expected):
    assert number(mean, sd) == expected


def test_other_forms():
    assert megabytes(1.5e6) == "1.50" and megabytes(2e6, 1e5) == "2.00±0.10" and megabytes(2e6) == "2"
    assert signed_points(0.1) == "+10.0" and signed_points(-0.05, 0.01) == "-5.0±1.0"
    assert printed_percent(0.9086) == "90.86"


@given(st.lists(st.tuples(st.text(st.characters(codec="utf-8", exclude_characters="\r\x00")), finite, finite, st.none() | finite)))
def test_csv_gives_back_every_digit(cells):
    rows = [{"who": who, "size_m": size, "p": Spread(mean, sd, 2)} for who, size, mean, sd in cells]
    (name, content), *others = Page("t", [Table("table", rows, COLUMNS)], lambda: empty_picture("t")).csv_files().items()
    assert name == "table.csv" and not others
    found = rows_of_csv(content)
    assert len(found) == len(cells)
    for row, (who, size, mean, sd) in zip(found, cells, strict=True):
        assert row["who"] == who and float(row["size_m"]) == size and float(row["p_mean"]) == mean and row["p_n"] == "2"
        assert (row["p_sd"] == "") if sd is None else (float(row["p_sd"]) == sd)
        assert row["r_mean"] == row["r_sd"] == row["r_n"] == row["note"] == ""


def test_tables_of_a_name_are_one_file_other_columns_beside_and_other_rows_below():
    one, two = [{"who": "a", "size_m": 1, "note": "x"}], [{"who": "b", "size_m": 2}]
    tables = [
        Table("table", one, COLUMNS[:1]), Table("table", one, COLUMNS[2:3]), Table("table", two, COLUMNS[:1]),
        Table("table-more", two, COLUMNS[:1]),
    ]  # fmt: skip
    files = Page("t", tables, lambda: empty_picture("t")).csv_files()
    assert rows_of_csv(files["table.csv"]) == [{"who": "a", "size_m": "1"}, {"who": "b", "size_m": "2"}]
    assert files["table-more.csv"] == "who\nb\n"


def test_a_word_in_place_of_a_number_is_for_readers_only():
    table = Table("table", [{"who": "a", "status": "failed", "p": "failed"}], COLUMNS)
    row = rows_of_csv(Page("t", [table], lambda: empty_picture("t")).csv_files()["table.csv"])[0]
    assert row["p_mean"] == "" and row["status"] == "failed"
