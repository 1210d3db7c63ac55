"""Every code block of the documentation is covered by a rule that says how it is run."""

from pathlib import Path

import pytest

from tests.docs import rules
from tests.docs.blocks import Block, blocks, blocks_of
from tests.docs.rules import Way, rule_of, shortened, statements_of

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = blocks(ROOT)
STATEMENTS = [
    statement for block in BLOCKS if block.language == "sh" for statement in statements_of(block)
]


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_a_rule_covers_it(block: Block) -> None:
    if block.language == "sh":
        for statement in statements_of(block):
            rule_of(statement)
    else:
        assert block.language in rules.LANGUAGES


def test_what_is_run_elsewhere_is_run_there() -> None:
    for statement in STATEMENTS:
        rule = rule_of(statement)
        if rule.way is Way.ELSEWHERE:
            assert (ROOT / rule.by).is_file(), f"{statement}: {rule.by}"


@pytest.mark.parametrize("table", ["ELSEWHERE", "BY_HAND", "SHORTER", "LIVE", "NEEDED", "REFUSED"])
def test_no_rule_is_left_over(table: str) -> None:
    for pattern in getattr(rules, table):
        assert any(rules.matches(pattern, each) for each in STATEMENTS), pattern


def test_few_are_run_elsewhere() -> None:
    """A new command is run, not listed."""
    ways = [rule_of(statement).way for statement in STATEMENTS]
    run = [way for way in ways if way not in (Way.ELSEWHERE, Way.BY_HAND)]
    assert len(run) > 0.6 * len(ways)


def test_what_no_rule_covers_is_noticed() -> None:
    with pytest.raises(LookupError):
        rule_of("rm -r everything")


def test_blocks_are_found() -> None:
    page = (
        "a\n\n    make run\n\n1. b\n\n   ```sh\n   falconer doctor \\\n     --json  # c\n   ```\n"
    )
    indented, fenced = blocks_of("page.md", page)
    assert (indented.line, statements_of(indented)) == (3, ["make run"])
    assert (fenced.line, statements_of(fenced)) == (7, ["falconer doctor --json"])


def test_a_campaign_is_shortened_in_its_options_alone() -> None:
    short = shortened("falconer experiment ablation --seeds 20 --gate auto")
    assert short == "falconer experiment ablation --gate auto --seeds 1 --steps 5 --jobs 1"
    assert shortened("falconer doctor") == "falconer doctor"
