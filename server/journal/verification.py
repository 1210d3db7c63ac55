"""Whether a journal is whole: every entry sound, every link of the chain in place."""

from dataclasses import dataclass
from typing import Final

from server.journal.entry import Head, Sealed, is_sound
from server.journal.store import Store
from server.journal.tables import ENTRIES

PAGE: Final = 2000
MAX_PROBLEMS: Final = 20


@dataclass(frozen=True, slots=True)
class Verification:
    """What was found."""

    entries: int
    head: Head
    problems: tuple[str, ...]
    """In words, the first ones; empty for a journal that is whole."""

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


class ChainChecker:
    """Follows a chain entry by entry."""

    def __init__(self) -> None:
        self.entries = 0
        self.head = Head()
        self.problems: list[str] = []

    def check(self, sealed: Sealed) -> None:
        """Take the next entry."""
        expected = self.head.seq + 1
        if sealed.seq != expected:
            last = sealed.seq - 1
            gone = f"{expected} is" if last == expected else f"{expected} to {last} are"
            self._note(f"entry {gone} missing")
        elif sealed.previous != self.head.hash:
            self._note(f"entry {sealed.seq} does not follow entry {self.head.seq}")
        if not is_sound(sealed):
            self._note(f"entry {sealed.seq} was changed: its hash is not that of its content")
        self.entries += 1
        self.head = Head(sealed.seq, sealed.hash)

    def _note(self, problem: str) -> None:
        if len(self.problems) < MAX_PROBLEMS:
            self.problems.append(problem)


async def verify(store: Store) -> Verification:
    """Read the whole journal and return what is wrong with it. Raises StoreError."""
    checker = ChainChecker()
    while True:
        page = await store.entries(ENTRIES.c.seq > checker.head.seq, limit=PAGE)
        for sealed in page:
            checker.check(sealed)
        if len(page) < PAGE:
            break
    damaged = await store.damaged_checkpoints()
    problems = [*checker.problems, *(f"the checkpoint of mission {m} is damaged" for m in damaged)]
    return Verification(checker.entries, checker.head, tuple(problems))
