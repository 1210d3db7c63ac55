import re

from console import zones
from console.ledger import Ledger
from tests.console.messages import message
from tests.console.test_ledger import card, event


def words(html: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html)).strip()


def test_a_line_says_what_where_how_far_and_since_when() -> None:
    said = message()
    ledger = Ledger()
    hit = {"robot": 21, "kind": "sensing", "zone": "s1", "new": True}
    ledger.note_event(event("attack", hit, 63.0))
    ledger.note_card(card(1, 70.0, severities={"s1": [1.0, 2.0]}))
    long, short = said["zones"][0]["keep_out_axes_m"]
    assert words(zones.line(said["zones"][0], said, ledger)) == (
        f"s1 sensing (-2.5, 1.0) {long:.1f} × {short:.1f} m"
        " found by an attack on D21 at 1:03.0; severity by ada at 1:10.0"
    )


def test_a_line_says_who_does_not_know() -> None:
    said = message()
    line = words(zones.line(said["zones"][1], said, Ledger()))
    assert line.endswith("known from the start; not known to D26")


def test_an_inferred_zone_says_how_sure_it_is() -> None:
    said = message()
    known = {"centre_covariance": [[0.3, 0.0], [0.0, 0.34]], "since_s": 63.0}
    found = {"origin": "inferred", "confidence": 0.72, "inferred": known}
    line = zones.line(said["zones"][0] | found, said, Ledger())
    assert 'class="zone sensing cloud"' in line
    assert "inferred, 72 % sure; centre to 0.8 m; suspected since 1:03.0" in words(line)


def test_nothing_from_outside_is_run() -> None:
    said = message()
    evil = said["zones"][0] | {"id": '"><script>', "kind": "<b>"}
    html = zones.line(evil, said, Ledger())
    assert "<script" not in html
    assert "<span>&lt;b&gt;</span>" in html


def test_bounds_and_defaults_are_the_missions_or_those_of_old_recordings() -> None:
    said = message()
    said["directives"]["severity_bounds"] = [1.0, 3.0]
    assert zones.severity_bounds(said) == (1.0, 3.0)
    assert zones.defaults(said)["communication"] == {"margin": 0.2, "risk": 0.05}
    del said["directives"]["severity_bounds"], said["zone_defaults"]
    assert zones.severity_bounds(said) == zones.DEFAULT_BOUNDS
    assert zones.defaults(said) == zones.FALLBACK
