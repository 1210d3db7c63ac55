"""The comments that stand, and what became of them."""

from dataclasses import replace

from solver.directives import CommentVerdict, Proposal, Source
from solver.observations import Comment
from solver.snapshot import CommentReceipt

MAX_STANDING = 32
"""More at once are refused where they come in; here the oldest expires first."""

CLOSED_KEPT = 64


class CommentLedger:
    """Owner of the receipts. A comment stands until it expires or is withdrawn."""

    def __init__(self) -> None:
        self._standing: dict[str, CommentReceipt] = {}
        self._closed: dict[str, CommentReceipt] = {}

    def restore(
        self, standing: tuple[CommentReceipt, ...], closed: tuple[CommentReceipt, ...]
    ) -> None:
        """Take the receipts of a checkpoint."""
        self._standing = {receipt.comment.id: receipt for receipt in standing}
        self._closed = {receipt.comment.id: receipt for receipt in closed}

    def receive(self, comment: Comment) -> None:
        """Let a comment stand. The same id again changes nothing."""
        if comment.id in self._standing or comment.id in self._closed:
            return
        if len(self._standing) >= MAX_STANDING:
            self._close(next(iter(self._standing)))
        self._standing[comment.id] = CommentReceipt(comment)

    def expire(self, now_s: float) -> tuple[str, ...]:
        """Close the comments whose time is over; return their ids."""
        over = tuple(
            cid
            for cid, receipt in self._standing.items()
            if now_s >= receipt.comment.time_s + receipt.comment.ttl_s
        )
        for cid in over:
            self._close(cid)
        return over

    def answer(self, proposal: Proposal) -> None:
        """Note what a model's accepted proposal says about the comments.

        A refused proposal answers nothing: the comment stays in the prompt. The answer that
        applied a comment stays, and with it the decision it names: later ones find nothing left
        to change, or are refused for other reasons.
        """
        for said in proposal.comment_answers:
            receipt = self._standing.get(said.comment_id)
            if receipt is None:
                continue
            action = proposal.source is Source.ACTION_LLM
            if _stays(receipt.action if action else receipt.task, said.verdict):
                continue
            if action:
                receipt = replace(
                    receipt,
                    action=said.verdict,
                    action_reason=said.reason,
                    action_feedback=proposal.feedback,
                    action_proposal=proposal.id,
                )
            else:
                receipt = replace(
                    receipt,
                    task=said.verdict,
                    task_reason=said.reason,
                    task_feedback=proposal.feedback,
                    task_proposal=proposal.id,
                )
            self._standing[said.comment_id] = receipt

    def standing(self) -> tuple[CommentReceipt, ...]:
        """Return the receipts of comments that still stand, oldest first."""
        return tuple(self._standing.values())

    def closed(self) -> tuple[CommentReceipt, ...]:
        """Return the lately closed receipts, oldest first."""
        return tuple(self._closed.values())

    def _close(self, comment_id: str) -> None:
        receipt = self._standing.pop(comment_id)
        self._closed[comment_id] = replace(receipt, expired=True)
        while len(self._closed) > CLOSED_KEPT:
            del self._closed[next(iter(self._closed))]


def _stays(before: CommentVerdict | None, said: CommentVerdict) -> bool:
    """Tell whether a loop's earlier verdict outlasts what it says now."""
    if before is CommentVerdict.PARTLY:
        return said is not CommentVerdict.APPLIED
    return before is CommentVerdict.APPLIED
