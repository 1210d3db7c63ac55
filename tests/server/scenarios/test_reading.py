"""YAML from strangers: what is read, and what is refused with its place."""

import math
from pathlib import Path

import pytest

from server.scenarios.errors import ScenarioError
from server.scenarios.reading import MAX_BYTES, parse, read


def test_words_stay_words_and_numbers_are_numbers() -> None:
    text = "gate: off\nanswer: no\nsmall: 1e-3\nlarge: -2.5E+4\nclock: 12:30\nfull: 7\nnone: ~"
    assert parse(text, "file") == {
        "gate": "off",
        "answer": "no",
        "small": 0.001,
        "large": -25000.0,
        "clock": "12:30",
        "full": 7,
        "none": None,
    }


@pytest.mark.parametrize(("text", "value"), [("true", True), ("False", False), (".5", 0.5)])
def test_plain_values(text: str, value: object) -> None:
    assert parse(f"key: {text}", "file")["key"] == value


def test_not_a_number_is_read_as_such() -> None:
    assert math.isnan(parse("x: .nan", "file")["x"])
    assert parse("x: -.inf", "file")["x"] == -math.inf


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1, 2\nb: 3", "line 2"),
        ("a: 1\n\tb: 2", "line 2"),
        ("a: 1\nb: 2\na: 3", 'line 3, column 1: is not valid here: the key "a" appears twice'),
        ("a:\n  b: 1\n  b: 2", 'line 3, column 3: is not valid here: the key "b" appears twice'),
        ("a: &x [1]\nb: *x", "line 2, column 4: is not valid here: aliases are not allowed"),
        ("a: !!python/object/apply:os.system [ls]", "line 1"),
        ("? [1, 2]\n: 3", "a key must be a plain word or number"),
        ("a: \x00", "is not YAML"),
        ("- 1\n- 2", "must be a mapping"),
        ("", "must be a mapping"),
        ("just words", "must be a mapping"),
        ("a: " + "[" * 5000 + "]" * 5000, "is nested too deeply"),
    ],
)
def test_what_cannot_be_read_says_why(text: str, words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse(text, "team.yaml")
    assert len(caught.value.problems) == 1
    assert str(caught.value).startswith("team.yaml: ")
    assert words in str(caught.value)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    missing, folder, binary = tmp_path / "missing.yaml", tmp_path / "x.yaml", tmp_path / "b.yaml"
    folder.mkdir()
    binary.write_bytes(b"\xff\xfe\x00a: 1")
    for path, words in (
        (missing, "cannot be read: No such file"),
        (folder, "cannot be read: Is a directory"),
        (binary, "is not UTF-8 text"),
    ):
        with pytest.raises(ScenarioError) as caught:
            read(path)
        assert f"{path}: {words}" in str(caught.value)


def test_a_file_of_more_than_the_limit_is_refused_unparsed(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    path.write_bytes(b"a: 1\n#" + b"x" * MAX_BYTES)
    with pytest.raises(ScenarioError, match="larger than the 1 MiB allowed"):
        read(path)
    path.write_bytes(b"a: 1\n#" + b"x" * (MAX_BYTES - 6))
    assert read(path) == {"a": 1}
