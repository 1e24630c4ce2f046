"""`:put [menu print detail as-value]`: one line, `;` between fields, a new record at each `.id=`."""

from __future__ import annotations

import re

__all__ = ["parse_rows"]

_FIELD = re.compile(r"(?:\A|;)(\.?[a-z0-9][a-z0-9.-]*)=")


def parse_rows(text: str) -> list[dict[str, str]]:
    """Rows by property name.

    A list's own `;` parts belong to the value before it: a part without `name=` is no field. A value that itself holds
    `;name=` cannot be told from a field; ask for such properties one by one (`get`).
    """
    rows: list[dict[str, str]] = []
    starts = list(_FIELD.finditer(text))
    for place, match in enumerate(starts):
        end = starts[place + 1].start() if place + 1 < len(starts) else len(text)
        name, value = match[1], text[match.end() : end]
        if name == ".id" or not rows:
            rows.append({})
        rows[-1][name] = value.rstrip(";")
    return rows
