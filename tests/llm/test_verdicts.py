"""What a verdict says, and to whom: models, and people who ask in person."""

from dataclasses import replace

import pytest

from llm.quoting import label, labels
from llm.verification import PROMPT_ROUNDING, keeps, pins_with, verify
from solver.directives import Pairing, Pin, Proposal, Source
from solver.observations import Link
from tests.llm.builders import LIMITS, WEIGHTS, Scene, ablation, hardware, zone

NO_ROOM = "Drone {} cannot be pinned to Target {}: it can track at most {}, and other pins stand."

TASK = frozenset({Source.TASK_LLM, Source.EXACT, Source.REPAIR, Source.OPERATOR})
ACTION = frozenset({Source.ACTION_LLM, Source.OPERATOR})
PEOPLE = frozenset({Source.OPERATOR})
NOT_TASK = "Assignments and capacities are not yours to change."
NOT_ACTION = "Weights, severities and replanning are not yours to change."
NOT_PINS = "Pins are not yours to set or lift."

HARD = Pin("h", Pairing(21, 124), None)
SOFT = Pin("s", Pairing(21, 124), None, "c1")
SOFTLY_FORBIDDEN = Pin("f", Pairing(21, 122), None, "c1", forbids=True)


def asked(scene: Scene, **changes: object) -> tuple[str, ...]:
    """Return what an operator is told who asks for some changes."""
    proposal = Proposal(id="p1", source=Source.OPERATOR, asked_s=9.0)
    return verify(replace(proposal, **changes), scene.snapshot(), LIMITS).violations  # type: ignore[arg-type]


def rows(**given: tuple[int, ...]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    return tuple((int(name.removeprefix("r")), target_ids) for name, target_ids in given.items())


def test_a_pin_set_again_is_the_newest_and_a_lifted_one_is_gone() -> None:
    pins = (HARD, SOFT, SOFTLY_FORBIDDEN)
    again = Pin("h", Pairing(21, 122), 30.0)
    proposal = Proposal(
        id="p1", source=Source.OPERATOR, asked_s=9.0, pins_set=(again,), pins_lifted=("f",)
    )
    assert pins_with(pins, proposal) == (SOFT, again)
    assert pins_with((), proposal) == (again,)


@pytest.mark.parametrize("forbids", [False, True])
@pytest.mark.parametrize("given", [False, True])
def test_an_assignment_keeps_a_pin_that_it_does_as_wanted(forbids: bool, given: bool) -> None:
    pin = Pin("x", Pairing(21, 124), None, forbids=forbids)
    assignment = frozenset({Pairing(26, 124), *([Pairing(21, 124)] if given else [])})
    assert keeps(assignment, pin) is (given is not forbids)


@pytest.mark.parametrize(
    ("changes", "pair", "said"),
    [
        ({}, (21, 124), ()),
        ({}, (99, 124), ("There is no Drone 99; the drones are 21 and 26.",)),
        ({}, (21, 7), ("There is no Target 7; the targets are 122 and 124.",)),
        (
            {"dropped": [124]},
            (21, 124),
            ("Target 124 is no longer tracked by anybody, so it cannot be pinned.",),
        ),
        (
            {"links": {21: Link.JAMMED}},
            (21, 124),
            ("Drone 21 cannot be reached, so it cannot be pinned.",),
        ),
        (
            {"capacity": 1, "pins": [Pin("a", Pairing(21, 122), None)]},
            (21, 124),
            (),
        ),
        (
            {"capacity": 0},
            (21, 124),
            (NO_ROOM.format(21, 124, 0),),
        ),
    ],
)
def test_pins(changes: dict[str, object], pair: tuple[int, int], said: tuple[str, ...]) -> None:
    """The newest of an operator's pins stands where there is room for one of them only."""
    scene = replace(hardware(), **changes)  # type: ignore[arg-type]
    assert asked(scene, pins_set=(Pin("x", Pairing(*pair), None),)) == said


def test_pins_are_judged_one_by_one() -> None:
    pins = tuple(Pin(f"p{j}", Pairing(0, j), None) for j in range(3))
    assert asked(ablation(), pins_set=pins) == (NO_ROOM.format(0, 0, 2),)


def test_people_are_not_bound_by_what_a_comment_brought_about() -> None:
    bound = replace(hardware(), pins=[SOFT])
    assert asked(bound, assignment=rows(r21=(122,), r26=(124,))) == ()
    bound = replace(hardware(), pins=[SOFTLY_FORBIDDEN])
    assert asked(bound, assignment=rows(r21=(122,), r26=(124,))) == ()


def test_people_are_bound_by_their_own_pins_until_they_lift_them() -> None:
    bound = replace(hardware(), pins=[HARD])
    wanted = rows(r21=(122,), r26=(124,))
    assert asked(bound, assignment=wanted) == (
        "Drone 21 must keep Target 124: the operator fixed it.",
    )
    assert asked(bound, assignment=wanted, pins_lifted=("h",)) == ()
    kept = rows(r21=(124,), r26=(122,))
    assert asked(hardware(), assignment=kept, pins_set=(Pin("n", Pairing(21, 122), None),)) == (
        "Drone 21 must keep Target 122: the operator fixed it.",
    )


def test_a_comments_pin_that_an_assignment_keeps_goes_on_binding() -> None:
    """It still counts where covers are reckoned: with it in force a pin of one's own has room."""
    scene = replace(ablation(), capacity=1, pins=[Pin("s", Pairing(0, 0), None, "c1")])
    assert asked(scene, assignment=rows(r0=(0,), r1=(3,))) == ()
    own = Pin("x", Pairing(0, 0), None)
    assert asked(scene, assignment=rows(r0=(0,), r1=(3,)), pins_set=(own,)) == ()


def test_people_may_idle_drones_that_a_model_may_not() -> None:
    nobody = ((21, 0), (26, 0))
    assert asked(hardware(), capacities=nobody) == ()
    proposal = Proposal(id="p1", source=Source.TASK_LLM, asked_s=9.0, capacities=nobody)
    assert verify(proposal, hardware().snapshot(), LIMITS).violations == (
        "These capacities would leave targets without a drone that could have one.",
    )


@pytest.mark.parametrize(
    ("changes", "capacities", "refused"),
    [
        ({}, ((21, 1),), False),
        ({"capacity": {21: 2, 26: 0}}, ((21, 1),), True),
        ({"blind": [26]}, ((21, 1),), True),  # covered still, but by a drone that cannot see
        ({"blind": [26]}, ((26, 0),), False),
        ({"pins": [Pin("x", Pairing(26, 124), None, forbids=True)]}, ((21, 1),), False),
        (
            {"pins": [Pin(f"x{j}", Pairing(26, j), None, forbids=True) for j in (122, 124)]},
            ((21, 1),),
            True,
        ),
        (  # 26 may have no target anyhow
            {
                "capacity": {21: 1, 26: 2},
                "pins": [Pin(f"x{j}", Pairing(26, j), None, forbids=True) for j in (122, 124)],
            },
            ((26, 0),),
            False,
        ),
    ],
)
def test_a_model_may_lower_capacities_as_long_as_nobody_loses_cover(
    changes: dict[str, object], capacities: tuple[tuple[int, int], ...], refused: bool
) -> None:
    scene = replace(hardware(), **changes)  # type: ignore[arg-type]
    proposal = Proposal(id="p1", source=Source.TASK_LLM, asked_s=9.0, capacities=capacities)
    assert verify(proposal, scene.snapshot(), LIMITS).accepted is not refused


@pytest.mark.parametrize(
    ("capacity", "said"),
    [
        (2, "each target must be tracked by at least one drone."),
        ({0: 1, 1: 2}, "only 1 target has to stay without one for want of capacity."),
        (1, "only 2 targets have to stay without one for want of capacity."),
    ],
)
def test_how_many_targets_may_stay_without_a_drone_is_told(
    capacity: int | dict[int, int], said: str
) -> None:
    scene = replace(ablation(), capacity=capacity)
    (told,) = asked(scene, assignment=rows(r0=(0,), r1=()))
    assert told == f"Target 1, Target 2 and Target 3 are tracked by no drone; {said}"


def test_one_target_too_many_is_told_as_one() -> None:
    scene = replace(ablation(), capacity=0)
    assert asked(scene, assignment=rows(r0=(0,), r1=())) == (
        "Drone 0 has 1 target but can track at most 0.",
    )


@pytest.mark.parametrize("source", list(Source))
@pytest.mark.parametrize(
    ("changes", "allowed", "said"),
    [
        ({"assignment": rows(r21=(122,), r26=(124,))}, TASK, NOT_TASK),
        ({"capacities": ((21, 2),)}, TASK, NOT_TASK),
        ({"weights": tuple(WEIGHTS)}, ACTION, NOT_ACTION),
        ({"severities": (("s1", 5.0),)}, ACTION, NOT_ACTION),
        ({"replan": (21,)}, ACTION, NOT_ACTION),
        ({"pins_set": (HARD,)}, PEOPLE, NOT_PINS),
        ({"pins_lifted": ("h",)}, PEOPLE, NOT_PINS),
    ],
)
def test_who_may_ask_for_what(
    source: Source, changes: dict[str, object], allowed: frozenset[Source], said: str
) -> None:
    proposal = replace(Proposal(id="p7", source=source, asked_s=9.0), **changes)  # type: ignore[arg-type]
    verdict = verify(proposal, hardware().snapshot(), LIMITS)
    assert verdict.proposal_id == "p7"
    assert verdict.violations == (() if source in allowed else (said,))


def test_every_wrong_capacity_is_told_and_nothing_else() -> None:
    """Idling is judged of capacities that could be: the first two here could not."""
    proposal = Proposal(
        id="p1", source=Source.TASK_LLM, asked_s=9.0, capacities=((99, 1), (21, 9), (26, 0))
    )
    assert verify(proposal, hardware().snapshot(), LIMITS).violations == (
        "There is no Drone 99, so it has no capacity.",
        "The capacity of Drone 21 must be between 0 and 2, not 9.",
    )
    idling = replace(proposal, capacities=((21, 0), (26, 0), (99, 1)))
    assert verify(idling, hardware().snapshot(), LIMITS).violations == (
        "There is no Drone 99, so it has no capacity.",
    )
    idling = replace(proposal, capacities=((21, 0), (26, 0), (21, 9)))
    assert verify(idling, hardware().snapshot(), LIMITS).violations == (
        "The capacity of Drone 21 is given twice.",
        "The capacity of Drone 21 must be between 0 and 2, not 9.",
    )


def test_a_drone_cut_off_without_a_target_keeps_none() -> None:
    scene = replace(hardware(), rows={21: [], 26: [122, 124]}, links={21: Link.JAMMED})
    (told,) = asked(scene, assignment=rows(r21=(122,), r26=(122, 124)))
    assert told.endswith(" cannot be reached, so it keeps no target: leave it out or repeat that.")


def test_a_forbidden_pair_excuses_nobody_where_another_drone_has_room() -> None:
    scene = replace(hardware(), pins=[Pin("x", Pairing(21, 122), None, forbids=True)])
    assert asked(scene, assignment=rows(r21=(124,), r26=())) == (
        "Target 122 is tracked by no drone; each target must be tracked by at least one drone.",
    )
    full = replace(scene, capacity={21: 2, 26: 0})
    assert asked(full, assignment=rows(r21=(124,), r26=())) == ()


def test_a_forbidding_pin_takes_no_room() -> None:
    scene = replace(ablation(), capacity=1, pins=[Pin("x", Pairing(0, 1), None, forbids=True)])
    assert asked(scene, pins_set=(Pin("y", Pairing(0, 0), None),)) == ()
    assert asked(scene, pins_set=(Pin("y", Pairing(0, 1), None),)) == (), "the newer one stands"


@pytest.mark.parametrize("order", [((26, 0), (21, -1)), ((21, -1), (26, 0))])
def test_idling_is_not_told_of_capacities_that_cannot_be(
    order: tuple[tuple[int, int], ...],
) -> None:
    proposal = Proposal(id="p1", source=Source.TASK_LLM, asked_s=9.0, capacities=order)
    assert verify(proposal, hardware().snapshot(), LIMITS).violations == (
        "The capacity of Drone 21 must be between 0 and 2, not -1.",
    )


def test_who_forbade_a_pair_is_told() -> None:
    scene = replace(hardware(), pins=[SOFTLY_FORBIDDEN])
    proposal = Proposal(
        id="p1", source=Source.TASK_LLM, asked_s=9.0, assignment=rows(r21=(122,), r26=(124,))
    )
    (told,) = verify(proposal, scene.snapshot(), LIMITS).violations
    assert told.startswith("Drone 21 must not track Target 122: a comment of the human supervisor")


@pytest.mark.parametrize(
    ("severity", "refused"),
    [
        (3.0, False),
        (3.0 * (1.0 - PROMPT_ROUNDING), False),
        (3.0 * (1.0 - 2e-3), True),
        (3.001, False),
    ],
)
def test_a_severity_may_be_repeated_as_the_prompt_rounded_it(
    severity: float, refused: bool
) -> None:
    scene = replace(hardware(), severities={"s1": 3.0})
    proposal = Proposal(
        id="p1", source=Source.ACTION_LLM, asked_s=9.0, severities=(("s1", severity),)
    )
    said = ("The severity of zone s1 is 3; only an operator may lower it.",) if refused else ()
    assert verify(proposal, scene.snapshot(), LIMITS).violations == said


def test_a_severity_given_twice_is_told_by_the_name_the_prompt_gave_the_zone() -> None:
    odd = "a zone\nof many words"
    scene = replace(hardware(), zones=(zone(odd),))
    proposal = Proposal(
        id="p1",
        source=Source.ACTION_LLM,
        asked_s=9.0,
        severities=((odd, 2.0), (odd, 3.0), ("gone", 2.0), ("gone", 2.0)),
    )
    assert verify(proposal, scene.snapshot(), LIMITS).violations == (
        f"The severity of zone {labels([odd])[odd]} is given twice.",
        f"The severity of zone {label('gone')} is given twice.",
        f"No zone {label('gone')} is known.",
    )
