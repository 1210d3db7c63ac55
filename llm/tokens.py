"""A deterministic estimate of token counts, for endpoints that report none."""

import re

_PIECES = re.compile(r"\w+|[^\w\s]")
LONGEST_PIECE = 6
"""Characters of a word that common vocabularies keep in one token, on average."""


def estimate_tokens(text: str) -> int:
    """Return about how many tokens a text has: words in pieces, and punctuation marks."""
    return sum(-(-len(piece) // LONGEST_PIECE) for piece in _PIECES.findall(text))
