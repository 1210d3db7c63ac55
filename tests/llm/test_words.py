"""Small pieces of English."""

import pytest

from llm import words


@pytest.mark.parametrize(
    ("parts", "said"),
    [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")],
)
def test_lists_are_joined_as_people_do(parts: list[str], said: str) -> None:
    assert words.listed(parts) == said


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (50.0, "50"),
        (0.05, "0.05"),
        (1234.56, "1235"),
        (1e6, "1000000"),
        (2.5e-5, "0.000025"),
        (1.23456e-6, "0.000001235"),
        (-9.99999e-6, "-0.00001"),
        (1.5e20, "150000000000000000000"),
    ],
)
def test_numbers_are_brief_and_have_no_exponent(value: float, said: str) -> None:
    assert words.number(value) == said


@pytest.mark.parametrize("bound", [0.0, 1.0, 0.123456, 12345.6, 99999.0, 1.2345678e-7])
def test_bounds_are_kept_by_the_number_that_is_written(bound: float) -> None:
    least, most = words.at_least(bound), words.at_most(bound)
    assert float(least) >= bound >= float(most)
    assert "e" not in least + most


def test_long_texts_are_cut_and_say_so() -> None:
    assert words.cut("abcdef", 6) == "abcdef"
    assert words.cut("abcdefg", 6) == "abc..."


def test_what_no_file_can_hold_is_replaced() -> None:
    assert words.writable("a \ud83d b \U0001f600 \u00e9") == "a ? b \U0001f600 \u00e9"
