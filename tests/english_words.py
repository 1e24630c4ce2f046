"""English words in Portuguese text: function words that nearly every English sentence has, and no Portuguese one."""

import re

ENGLISH = re.compile(
    r"(?<![\w/.=-])(the|of|is|are|was|were|not|and|or|with|without|for|from|has|have|had|this|that|these|by|to|in|on|at|"
    r"it|its|be|been|can|cannot|must|will|would|which|when|where|what|who|if|than|then|only|nothing|each|every|your|you)"
    r"(?![\w/.=-])",
    re.IGNORECASE,
)
"""Without `a`, `as`, `do`, `no`, which are Portuguese as well."""
NAMED = re.compile(r'`[^`]+`|"[^"]*"|(?:\./)?provision [^\n]*')
"""What stays as it is in every language: names and commands in back quotes, rows of a device in quotes."""


def without_names(text: str) -> str:
    """The text with `…` for each name and command."""
    return NAMED.sub("`…`", text)


def english_parts(text: str) -> list[str]:
    """Where an English word stands, with the words around it."""
    return [text[max(0, match.start() - 40) : match.end() + 40] for match in ENGLISH.finditer(text)]
