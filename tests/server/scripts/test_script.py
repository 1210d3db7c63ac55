from pathlib import Path

import pytest

from server.scripts.script import Do, Say, ScriptError, load_script

GOOD = """
name: smoke
mission: {scenario: demo, llm: none, gate: auto}
until_s: 20
actions:
  - {at_s: 3, say: hello, expect: [noted]}
  - {at_s: 5, do: hold}
expect:
  min_separation_m: {at_least: 0.3}
"""


def loaded(tmp_path: Path, text: str) -> object:
    return load_script(_file(tmp_path, text))


def test_a_script_is_read(tmp_path: Path) -> None:
    script = load_script(_file(tmp_path, GOOD))
    assert script.mission.scenario == "demo"
    assert isinstance(script.actions[0], Say)
    assert isinstance(script.actions[1], Do)
    assert script.expect["min_separation_m"].at_least == 0.3


def test_the_script_that_comes_with_falconer_is_read() -> None:
    root = Path(__file__).parents[3]
    script = load_script(root / "scenarios" / "scripts" / "headless.yaml")
    assert script.mission.scenario == "mixed"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("do: hold", "do: dance", "hold"),
        ("at_s: 5", "at_s: 20", "not before until_s"),
        ("at_s: 5", "at_s: -1", "actions.1"),
        ("until_s: 20", "until_s: .inf", "until_s"),
        ("name: smoke", "name: smoke\ntypo: 1", "typo"),
        ("{at_least: 0.3}", "{}", "at_least"),
        ("{at_least: 0.3}", "{at_least: 2, at_most: 1}", "at_least"),
        ("gate: auto", "gate: ajar", "mission.gate"),
        ("until_s: 20", "until_s: 20\nuntil_s: 30", "twice"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(ScriptError, match=words):
        loaded(tmp_path, GOOD.replace(old, new))


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(ScriptError, match="cannot be read"):
        load_script(tmp_path / "none.yaml")


def _file(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "script.yaml"
    file.write_text(text)
    return file
