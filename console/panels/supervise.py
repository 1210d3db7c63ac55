"""The conversation with the models: the box to write in, and each comment's receipt."""

from collections.abc import Iterable, Mapping

from nicegui import ui

from console.board import Facts
from console.panel import Desk, Panel
from console.panels.decisions import CARDS_LOOKED_AT
from console.panels.suggestions import Offers
from console.render import STATUS_WORDS, Json, clock, escape
from server.api.models import MAX_COMMENT_CHARACTERS

COMMENTS_SHOWN = 40


class SupervisePanel(Panel):
    """Comments, sentences to tap, and receipts."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the receipts."""
        comments = facts.service.comments(facts.mission.id)[-COMMENTS_SHOWN:]
        decided = {
            card.get("proposal", ""): card["id"]
            for card in facts.service.newest_decisions(facts.mission.id, CARDS_LOOKED_AT)
        }
        return {"receipts": receipts((each.model_dump() for each in comments), decided)}

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._offers = Offers()

    def build(self) -> None:
        """Make the box; only who may steer gets one."""
        if self.desk.operates:
            with ui.element("div").classes("write"):
                self._text = (
                    ui.textarea(placeholder="Tell the models what matters, in plain words")
                    .props(
                        f'borderless autogrow maxlength="{MAX_COMMENT_CHARACTERS}"'
                        ' input-class="comment-box" aria-label="Comment"'
                    )
                    .classes("text")
                    .on("keydown.enter.exact.prevent", self._send)
                )
                ui.button("Send", on_click=self._send, color=None).props(
                    "unelevated no-caps"
                ).classes("send")
            self._chips = ui.element("div").classes("chips")
            for event in ("mouseenter", "focusin"):
                self._chips.on(event, lambda: self._reach(over=True))
            for event in ("mouseleave", "focusout"):
                self._chips.on(event, lambda: self._reach(over=False))
        else:
            ui.html("You may look. Comments need an operator.", sanitize=False).classes("empty")
        self.html("receipts", "scroll receipts")

    def refresh(self) -> None:
        """Show receipts, and now and then other sentences."""
        super().refresh()
        if self.desk.operates and self._offers.renew(self.desk.board.snapshot):
            self._chips.clear()
            with self._chips:
                for sentence in self._offers.sentences:
                    ui.button(
                        sentence, on_click=lambda _, s=sentence: self._take(s), color=None
                    ).props("flat no-caps dense").classes("chip-button")

    def _reach(self, *, over: bool) -> None:
        self._offers.reached_for = over

    def _take(self, sentence: str) -> None:
        self._text.set_value(sentence)
        self._text.run_method("focus")

    async def _send(self) -> None:
        """Give the comment to the mission; on refusal it stays in the box."""
        text = (self._text.value or "").strip()
        if not text:
            return
        sent = await self.desk.act(
            lambda service, mission, author: service.comment(mission, text, author)
        )
        if sent is not None:
            self._text.set_value("")
            self._offers.spoken()


def receipts(comments: Iterable[Json], decided: Mapping[str, str]) -> str:
    """Return the conversation, newest first: each comment and what became of it.

    `decided` names the decision that each proposal came to.
    """
    cards = []
    for comment in reversed(list(comments)):
        status = comment["status"]
        answers = "".join(
            f'<p class="answer"><b>{title}</b> {STATUS_WORDS[answer["verdict"]].lower()}'
            f"{': ' + escape(answer['reason']) if answer['reason'] else ''}"
            f"{_card(decided.get(answer['proposal']))}</p>"
            for title, answer in (
                ("Task model", comment["task"]),
                ("Action model", comment["action"]),
            )
            if answer is not None
        )
        cards.append(
            f'<article class="receipt {status}" data-id="{escape(comment["id"])}" tabindex="-1">'
            f'<header><span class="chip">{STATUS_WORDS[status]}</span>'
            f"<span>{escape(comment['author'])} · {clock(comment['time_s'])}</span></header>"
            f"<p>{escape(comment['text'])}</p>{answers or _waiting(status)}</article>"
        )
    empty = (
        '<p class="empty">Nothing said yet. The models read your comment at their next call; '
        "the answer appears here.</p>"
    )
    return "".join(cards) or empty


def _card(decision: str | None) -> str:
    """Return a link to the decision that an answer came to."""
    if decision is None:
        return ""
    name = escape(decision)
    return f' <button type="button" class="link" data-reveal="{name}">{name}</button>'


def _waiting(status: str) -> str:
    words = "Waiting for the models." if status == "received" else "Its time is over."
    return f'<p class="answer">{words}</p>' if status in {"received", "expired"} else ""
