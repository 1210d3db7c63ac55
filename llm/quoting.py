"""How other people's words stand in a prompt: as data, never as instructions.

Comments become one-line JSON strings without angle brackets inside a marked block, so no
text can close the block or start a line of its own. Names of zones are cut down to short
plain labels. This makes an injected instruction visible as a quotation; what really bounds
it is the verification.
"""

import json
import re
import unicodedata
from collections.abc import Iterable, Mapping

from llm import words

BLOCK_START = "<<<COMMENTS"
BLOCK_END = "COMMENTS>>>"
LONGEST_QUOTE = 400
LONGEST_LABEL = 24

_NOT_LABEL = re.compile(r"[^\w.-]+")
_SPACES = re.compile(r"\s+")


def quoted(text: str, length: int = LONGEST_QUOTE) -> str:
    """Return a text as one line of JSON string that cannot end or forge a block.

    Control and formatting characters are dropped, white space becomes single spaces, and
    the rest is cut to `length` characters.
    """
    normal = unicodedata.normalize("NFKC", text[: 8 * length])
    spaced = _SPACES.sub(" ", normal)
    plain = "".join(c for c in spaced if unicodedata.category(c)[0] != "C").strip()
    literal = json.dumps(words.cut(plain, length), ensure_ascii=False)
    return literal.replace("<", "\\u003c").replace(">", "\\u003e")


def label(name: str) -> str:
    """Return a name cut down to letters, digits, dots, dashes and underscores."""
    normal = unicodedata.normalize("NFKC", name[: 8 * LONGEST_LABEL])
    return _NOT_LABEL.sub("_", normal).strip("_")[:LONGEST_LABEL] or "unnamed"


def labels(names: Iterable[str]) -> Mapping[str, str]:
    """Return name -> label, each label unique; deterministic in the order of the names."""
    result: dict[str, str] = {}
    used: set[str] = set()
    for name in names:
        stem = label(name)
        unique, suffix = stem, 2
        while unique in used:
            unique, suffix = f"{stem}-{suffix}", suffix + 1
        used.add(unique)
        result[name] = unique
    return result
