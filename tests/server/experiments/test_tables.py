import csv
import io

from server.experiments.statistics import Estimate
from server.experiments.tables import Column, Table

TABLE = Table(
    "Figures",
    (Column("row", "row"), Column("trace", "trace", 1), Column("change", "change", 2, signed=True)),
    [
        {"row": "a|b", "trace": Estimate(86.5512, 1.234, 20), "change": Estimate(-0.5, None, 1)},
        {"row": "c", "trace": 3, "change": 0.25},
        {"row": "d", "trace": None},
    ],
)


def test_markdown_has_one_cell_per_column() -> None:
    lines = TABLE.markdown().splitlines()
    assert lines[0] == "| row | trace | change |"
    assert lines[2:] == ["| a/b | 86.6 ± 1.2 | -0.50 |", "| c | 3 | +0.25 |", "| d | - | - |"]
    assert {line.count("|") for line in lines} == {4}


def test_csv_keeps_every_digit_and_splits_estimates() -> None:
    rows = list(csv.DictReader(io.StringIO(TABLE.csv())))
    assert list(rows[0]) == ["row", "trace", "trace_half_width", "change", "change_half_width"]
    assert (rows[0]["trace"], rows[0]["trace_half_width"]) == ("86.5512", "1.234")
    assert rows[0]["row"] == "a|b"
    assert rows[1]["trace"] == "3"
    assert rows[2]["trace"] == ""
