"""Every code block of README and docs/, as it stands there."""

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.house.documents import documents

FENCE = re.compile(r"^(?P<indent> *)```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^ *```", re.M | re.S)
INDENTED = re.compile(r"(?<=\n\n)(?:    [^\n]*\n)+")
COMMAND = re.compile(r"^(?:\.venv/bin/)?(?:falconer|python|make|curl|docker|pip)\b", re.M)


@dataclass(frozen=True, slots=True)
class Block:
    """One block: a fenced one with its language, or an indented one, which is a command."""

    page: str
    """From the root of the checkout."""

    line: int
    language: str
    text: str

    @property
    def name(self) -> str:
        """Return where it stands."""
        return f"{self.page}:{self.line}"

    def statements(self) -> list[str]:
        """Return the commands of a shell block: comments cut away, continued lines joined."""
        lines = self.text.replace("\\\n", " ").splitlines()
        bare = (re.sub(r"(^|\s+)# .*$", "", line).strip() for line in lines)
        return [re.sub(r" {2,}", " ", line) for line in bare if line]


def blocks(root: Path) -> list[Block]:
    """Return every block of every page, in order."""
    return [
        block
        for page in documents(root)
        for block in blocks_of(str(page.relative_to(root)), page.read_text("utf-8"))
    ]


def blocks_of(page: str, text: str) -> Iterator[Block]:
    """Yield the blocks of one page in order."""
    found = [
        (match.start(), match["language"], textwrap.dedent(match["text"]))
        for match in FENCE.finditer(text)
    ]
    plain = FENCE.sub(lambda fence: re.sub(r"[^\n]", " ", fence[0]), text)
    for match in INDENTED.finditer(plain):
        lines = [line[4:] for line in match[0].splitlines()]
        if COMMAND.match(lines[0]):  # else the next paragraph of an entry in a list
            found.append((match.start(), "sh", "\n".join(lines).strip() + "\n"))
    for start, language, block in sorted(found):
        yield Block(page, text.count("\n", 0, start) + 1, language, block)
