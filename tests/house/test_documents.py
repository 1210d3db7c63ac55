"""The readers of the documentation see what is there."""

from tests.house.documents import (
    anchors,
    command_lines,
    first_cells,
    links,
    sections,
)

PAGE = """\
# Title, with *stress*

## `falconer run`

| option | meaning |
|---|---|
| `--llm` | a \\| b |
| `--seed` | dice |

### Deeper

```sh
falconer run demo \\
    --seed 3   # three
.venv/bin/falconer doctor
## not a heading
```

## `falconer sim`

Try `falconer sim demo`, see [there](other.md#part) or [elsewhere](https://example.org).
"""


def test_sections_end_at_the_next_heading_of_their_level() -> None:
    found = sections(PAGE, 2)
    assert list(found) == ["`falconer run`", "`falconer sim`"]
    assert "Deeper" in found["`falconer run`"]
    assert "Try" not in found["`falconer run`"]
    assert list(sections(PAGE, 3)) == ["Deeper"]
    assert "Try" not in sections(PAGE, 3)["Deeper"]


def test_first_cells_leave_headers_and_rules_out() -> None:
    assert first_cells(PAGE) == ["`--llm`", "`--seed`"]


def test_commands_are_found_in_blocks_and_spans() -> None:
    assert command_lines(PAGE) == [
        ["run", "demo", "--seed", "3"],
        ["doctor"],
        ["run"],
        ["sim"],
        ["sim", "demo"],
    ]


def test_links_out_of_the_project_are_left_alone() -> None:
    assert links(PAGE) == ["other.md#part"]


def test_anchors_are_derived_as_code_hosts_do() -> None:
    assert {"title-with-stress", "falconer-run", "deeper"} <= anchors(PAGE)
