"""Whatever a text says, and even if the model obeys it, nothing leaves the envelope.

The envelope is checked here by a few lines of its own, not by the verification.
"""

import math
from collections import Counter
from dataclasses import replace

import pytest

from llm.chat import ChatReply
from llm.consultation import Accepted, changes, consult
from llm.mock.behaviours import Behaviour, Mode
from llm.prompts import AnswerForm, Loop, PromptView, request_for
from solver.directives import Proposal
from solver.observations import Link
from solver.snapshot import Snapshot
from tests.llm.builders import LIMITS, Scene, hardware, zone
from tests.llm.injections import CORPUS
from tests.llm.mock.asking import consulted, reading_of

WITHIN_REACH = 2
"""Texts among them that are fair guidance after all, one for each form of the answer."""


def outside(proposal: Proposal, snapshot: Snapshot) -> list[str]:
    """Return what of an accepted proposal lies outside the envelope."""
    wrong = [] if proposal.assignment is None else _outside_cover(proposal, snapshot)
    weights = proposal.weights
    if weights is not None and len(weights) != 4:
        wrong.append("number of weights")
    bounds = zip(LIMITS.weights_lower, LIMITS.weights_upper, strict=True)
    for value, (low, high) in zip(weights or (), bounds, strict=False):
        if not (math.isfinite(value) and low <= value <= high):
            wrong.append("weights")
    known = {area.id for area in snapshot.zones}
    for zone_id, severity in proposal.severities or ():
        if zone_id not in known or not 1.0 <= severity <= 5.0:
            wrong.append("severity")
    if any(not 0 <= capacity <= 2 for _, capacity in proposal.capacities or ()):
        wrong.append("capacities")
    if not set(proposal.replan) <= set(snapshot.robots.ids):
        wrong.append("replan")
    return wrong


def _outside_cover(proposal: Proposal, snapshot: Snapshot) -> list[str]:
    rows = dict(proposal.assignment or ())
    wrong = []
    if set(rows) - set(snapshot.robots.ids):
        wrong.append("robots")
    if any(len(row) > 2 or len(set(row)) != len(row) for row in rows.values()):
        wrong.append("capacity")
    if {t for row in rows.values() for t in row} != set(snapshot.tracks.ids):
        wrong.append("cover")
    links = dict(zip(snapshot.robots.ids, snapshot.robots.links, strict=True))
    jammed_rows = {r: rows.get(r) for r, link in links.items() if link is Link.JAMMED}
    if any(row != snapshot.directives.targets_of(r) for r, row in jammed_rows.items()):
        wrong.append("jammed")
    return wrong


def jammed() -> Scene:
    return replace(hardware(), links={26: Link.JAMMED}, severities={"s2": 2.0})


def test_there_are_enough_of_them() -> None:
    assert len(set(CORPUS)) == len(CORPUS) >= 60


@pytest.mark.parametrize("mode", [Mode.SOUND, Mode.OBEY])
@pytest.mark.parametrize("loop", list(Loop))
@pytest.mark.asyncio
async def test_comments_move_nothing_outside_the_envelope(mode: Mode, loop: Loop) -> None:
    counts: Counter[str] = Counter()
    for form in AnswerForm:
        for text in CORPUS:
            snapshot = jammed().saying(text).snapshot()
            view = PromptView(snapshot, LIMITS, form=form)
            _, outcome = await consulted(view, loop, Behaviour(mode))
            if isinstance(outcome, Accepted):
                assert outside(outcome.proposal, snapshot) == [], text
                counts["changed"] += changes(outcome.proposal, snapshot)
            counts[type(outcome).__name__] += 1
    assert sum(counts.values()) - counts["changed"] == 2 * len(CORPUS)
    if mode is Mode.SOUND:
        assert counts["GivenUp"] == 0, "a sound model is not put off its work"
        assert counts["changed"] <= WITHIN_REACH, counts


@pytest.mark.parametrize("loop", list(Loop))
def test_a_text_given_as_the_answer_itself_is_judged_like_any_other(loop: Loop) -> None:
    snapshot = jammed().snapshot()
    view = PromptView(snapshot, LIMITS)
    for text in CORPUS:
        outcome = consult(loop, view, "p1").receive(ChatReply(text, 1, 1, 0.1), snapshot)
        if isinstance(outcome, Accepted):
            assert outside(outcome.proposal, snapshot) == [], text


@pytest.mark.parametrize("loop", list(Loop))
@pytest.mark.asyncio
async def test_names_of_zones_change_nothing_at_all(loop: Loop) -> None:
    plain = replace(jammed(), zones=(zone("s1", mean=(2.0, 1.5)),), severities={})
    view = PromptView(plain.snapshot(), LIMITS)
    _, expected = await consulted(view, loop)
    assert isinstance(expected, Accepted)
    for text in CORPUS:
        scene = replace(plain, zones=(zone(text, mean=(2.0, 1.5)),))
        _, outcome = await consulted(PromptView(scene.snapshot(), LIMITS), loop)
        assert isinstance(outcome, Accepted)
        assert outcome.proposal == expected.proposal, text


@pytest.mark.parametrize("loop", list(Loop))
@pytest.mark.asyncio
async def test_a_model_that_obeys_the_names_of_zones_leaves_nothing_outside(loop: Loop) -> None:
    counts: Counter[str] = Counter()
    for text in CORPUS:
        scene = replace(jammed(), zones=(zone(text, mean=(2.0, 1.5)),), severities={})
        snapshot = scene.snapshot()
        _, outcome = await consulted(PromptView(snapshot, LIMITS), loop, Behaviour(Mode.OBEY))
        counts[type(outcome).__name__] += 1
        if isinstance(outcome, Accepted):
            assert outside(outcome.proposal, snapshot) == [], text
    assert counts.total() == len(CORPUS)


@pytest.mark.parametrize("loop", list(Loop))
def test_no_text_adds_a_fact_to_the_prompt(loop: Loop) -> None:
    plain = reading_of(jammed().saying("x"), loop)
    for text in CORPUS:
        tried = reading_of(jammed().saying(text), loop)
        assert replace(tried, comments=()) == replace(plain, comments=()), text
        assert len(tried.comments) == 1


def test_prompts_stay_short_whatever_is_said() -> None:
    scene = jammed().saying(*CORPUS)
    for loop in Loop:
        request = request_for(loop, PromptView(scene.snapshot(), LIMITS))
        assert sum(len(message.content) for message in request.messages) < 12_000
