"""Proposals that wait for a person, under the gate `confirm`."""

from math import ceil

from console.board import Facts
from console.panel import Panel
from console.panels.decisions import CARDS_LOOKED_AT, LOOP_WORDS, prediction, what
from console.render import Json, escape
from server.api.directing_models import ApprovalRequest

SHOWN = 6
"""At once; those that have least time left."""


class ApprovalsPanel(Panel):
    """Each with its predicted effect, the time left, and two buttons."""

    badge = "approvals_badge"
    styles = ("decisions.css",)

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return what waits, the most urgent first."""
        cards = facts.service.newest_decisions(facts.mission.id, CARDS_LOOKED_AT)
        waiting = [c for c in cards if c.get("status") == "pending" and c.get("approval")]
        waiting.sort(key=lambda each: each["approval"]["expires_s"])
        now_s = 0.0 if facts.snapshot is None else facts.snapshot["time_s"]
        more = len(waiting) - SHOWN
        rest = f'<p class="empty">and {more} more</p>' if more > 0 else ""
        return {
            "approvals": "".join(waiting_card(each, now_s) for each in waiting[:SHOWN]) + rest,
            "approvals_badge": str(len(waiting)) if waiting else "",
        }

    def build(self) -> None:
        """Show them."""
        self.desk.taps(self.html("approvals", "approvals"), self._answer)

    async def _answer(self, tapped: str) -> None:
        """Take a person's word."""
        verb, _, decision = tapped.partition(":")
        if verb not in ("approve", "refuse") or not decision:
            return
        body = ApprovalRequest(approve=verb == "approve")
        asked = {"id": decision, **body.model_dump()}
        done = await self.desk.act(
            lambda service, mission, author: service.direct(mission, "approval", asked, author)
        )
        if done is not None:
            self.desk.tell(f"{decision} {'approved' if body.approve else 'refused'}.")


def waiting_card(decision: Json, now_s: float) -> str:
    """Return one proposal that waits."""
    name = escape(decision["id"])
    left_s = max(0, ceil(decision["approval"]["expires_s"] - now_s))
    who = LOOP_WORDS.get(decision["loop"], escape(decision["loop"]))
    return (
        f'<article class="waiting" aria-label="{who} asks, {name}">'
        f"<header><b>{who} asks</b><span>{name}</span>"
        f'<span class="left">{left_s} s left</span></header>'
        f"{what(decision)}{prediction(decision)}"
        '<div class="answer-buttons">'
        f'<button type="button" class="go" data-tap="approve:{name}">Approve</button>'
        f'<button type="button" class="warn" data-tap="refuse:{name}">Refuse</button>'
        f'<button type="button" class="link" data-reveal="{name}">Card</button></div></article>'
    )
