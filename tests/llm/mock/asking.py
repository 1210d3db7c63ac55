"""Asking the mock as the mission does: prompt, real client, verification."""

from llm.consultation import Accepted, Consultation, Outcome, consult
from llm.mock.app import in_process_client
from llm.mock.behaviours import Behaviour
from llm.mock.reading import Reading, read
from llm.prompts import AnswerForm, Loop, PromptView, request_for
from solver.directives import CommentVerdict, Proposal
from tests.llm.builders import LIMITS, Scene

SOUND = Behaviour()


def reading_of(scene: Scene, loop: Loop = Loop.TASK) -> Reading:
    """Return what the mock understands of a scene's prompt."""
    request = request_for(loop, PromptView(scene.snapshot(), LIMITS))
    return read([(message.role, message.content) for message in request.messages])


async def consulted(
    view: PromptView, loop: Loop, behaviour: Behaviour = SOUND
) -> tuple[Consultation, Outcome]:
    """Run a whole logical call."""
    call = consult(loop, view, "p1")
    async with in_process_client(behaviour) as client:
        while True:
            reply = await client.complete(call.request, 10.0)
            outcome = call.receive(reply, view.snapshot)
            if isinstance(outcome, Accepted) or call.stats.tries == call.max_tries:
                return call, outcome


async def asked(
    scene: Scene, loop: Loop = Loop.TASK, form: AnswerForm = AnswerForm.JSON
) -> Proposal:
    """Return the proposal, accepted at the first answer."""
    call, outcome = await consulted(PromptView(scene.snapshot(), LIMITS, form=form), loop)
    assert isinstance(outcome, Accepted), outcome.reasons
    assert call.stats.valid_first
    return outcome.proposal


def rows_of(proposal: Proposal) -> dict[int, tuple[int, ...]]:
    """Return the proposed rows."""
    return dict(proposal.assignment or ())


def verdict_of(proposal: Proposal) -> tuple[CommentVerdict, str]:
    """Return the answer to the only comment."""
    (answer,) = proposal.comment_answers
    return answer.verdict, answer.reason
