"""What the tests of drawn panels share."""

import re

EVIL = '<script>alert("x")</script>'


def words(html: str) -> str:
    """Return what a reader sees of some HTML."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html)).strip()
