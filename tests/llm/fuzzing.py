"""Throws answers at the reading and the verification: true ones slightly off, and noise.

    python -m tests.llm.fuzzing --answers 20000

Nothing may escape but an outcome, none may take long, and what is accepted lies inside the
envelope, which is checked here by a few lines of its own. A finding names seed and number.
"""

import argparse
import json
import random
import time
from collections import Counter
from collections.abc import Iterator

from llm.chat import ChatReply
from llm.consultation import Accepted, Outcome, Retry, consult
from llm.prompts import Loop, PromptView
from tests.llm.builders import LIMITS
from tests.llm.injections import CORPUS
from tests.llm.test_injections import jammed, outside

LONGEST_S = 2.0
"""Of thread time for one answer."""

LONGEST_TEXT = 50_000
MOST_CHANGES = 6

SAMPLES = (
    '{"assignment": {"21": [122, 124], "26": [124]}, "feedback": "Fine."}',
    '```json\n{"assignment": [{"drone": 21, "targets": [122, 124]}], "capacities": []}\n```',
    "<think>Drone 26 is cut off.</think>\nDrone 21 should track Target 122 and Target 124.",
    "1. **Drone 21**: Targets 122, 124\n2. Drone 26: none\nFeedback to the human supervisor: Done.",
    "| Drone | Targets |\n|---|---|\n| Drone 21 | Target 122, Target 124 |",
    "Target 122 and Target 124 are tracked by Drone 21.",
    '{"weights": {"tracking": 20, "control": 0.05, "sensing": 50, "communication": 50}}',
    '{"weights": [20, 0.05, 50, 50], "severities": [{"zone": "s1", "severity": 2.5}]}',
    "[20, 0.05, 50, 50]\nSeverity of zone s2: 3\nReplan Drone 21\nComment c1: applied, done.",
    "w1 = 20, w2 = 0.05, w3 = 50, w4 = 60",
    "I'm sorry, I cannot help with that.",
)
NASTY = (
    *("NaN", "Infinity", "-1", "1e308", "1e-320", "0", "99999999999999999999", "0x10", "null"),
    *("true", '""', "{}", "[]", "[[[[", "}}}}", '{"a":' * 50, "\\", '"', "```", "\n", "\n\n"),
    *("Drone", "Target", "zone", "21", "122", "<think>", "</think>", "Comment c1: applied"),
    *("\x00", "\ud83d\ude00", "\u2028", "\u202e", "\uff19", "Feedback: ", ": ", "-> ", "| "),
    *("not ", "avoid ", "and ", "7" * 5000, "Replan Drone "),
)


def changed(text: str, dice: random.Random) -> str:
    """Return a text that somebody has been at."""
    for _ in range(dice.randint(1, MOST_CHANGES)):
        text = _at(text, dice)[:LONGEST_TEXT]
    return text


def _at(text: str, dice: random.Random) -> str:
    start, end = sorted((dice.randint(0, len(text)), dice.randint(0, len(text))))
    match dice.randrange(7):
        case 0:
            return text[:start] + dice.choice(NASTY) + text[start:]
        case 1:
            return text[:start] + text[end:]
        case 2:
            return text[:end] + text[start:end] + text[end:]
        case 3:
            return text[:start]
        case 4:
            return f"{text} {dice.choice(SAMPLES)}"
        case 5:
            return f"{dice.choice(CORPUS)[:500]} {text}"
        case _:
            return json.dumps(text)


def answers(seed: int, count: int) -> Iterator[str]:
    """Yield texts that are nearly answers, and some that are nothing like one."""
    dice = random.Random(seed)
    for _ in range(count):
        if dice.random() < 0.1:
            yield "".join(dice.choice(NASTY) for _ in range(dice.randint(0, 200)))
        else:
            yield changed(dice.choice(SAMPLES), dice)


def can_be_written(outcome: Outcome) -> bool:
    """Return whether all words of an outcome can be sent on and kept, as UTF-8."""
    if isinstance(outcome, Accepted):
        reasons = [answer.reason for answer in outcome.proposal.comment_answers]
        said = [outcome.proposal.feedback, *reasons]
    else:
        said = list(outcome.reasons)
    if isinstance(outcome, Retry):
        said += [message.content for message in outcome.request.messages]
    return all(text.isascii() or text.encode("utf-8", "replace").decode() == text for text in said)


def campaign(seed: int, count: int) -> Counter[str]:
    """Judge so many answers; return how they fared.

    Raises AssertionError naming seed and number where something is wrong.
    """
    snapshot = jammed().saying("Be careful.").snapshot()
    view, fared = PromptView(snapshot, LIMITS), Counter[str]()
    for number, text in enumerate(answers(seed, count)):
        for loop in Loop:
            began_s = time.thread_time()
            outcome = consult(loop, view, "p1").receive(ChatReply(text, 1, 1, 0.1), snapshot)
            spent_s = time.thread_time() - began_s
            where = f"seed {seed}, answer {number}, {loop.value} model: {text[:200]!r}"
            assert spent_s < LONGEST_S, f"{spent_s:.1f} s for {where}"
            if isinstance(outcome, Accepted):
                assert outside(outcome.proposal, snapshot) == [], where
            assert can_be_written(outcome), where
            fared[type(outcome).__name__] += 1
    return fared


def main() -> None:
    """Run the campaign and print how the answers fared."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--answers", type=int, default=20_000)
    arguments = parser.parse_args()
    fared = campaign(arguments.seed, arguments.answers)
    told = ", ".join(f"{count} {name}" for name, count in sorted(fared.items()))
    print(f"{arguments.answers} answers to both models, nothing escaped: {told}")  # noqa: T201


if __name__ == "__main__":
    main()
