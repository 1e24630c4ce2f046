"""librouteros as its documentation shows it: one connection, and one call at a time on the rows of a menu.

Idempotent as a careful user writes it: read the menu, compare row by row, set what differs, add what is missing, remove
what must not be there, move what stands in the wrong place.
"""

from __future__ import annotations

import json
import ssl
import sys
from pathlib import Path
from typing import Any

from librouteros import connect

Row = dict[str, Any]


def main() -> None:
    """Bring every menu to its declared rows, and print how many calls have changed something."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    context = ssl.create_default_context(cafile=job["ca"])
    context.check_hostname = False
    api = connect(
        host=job["host"],
        port=job["port"],
        username=job["user"],
        password=job["password"],
        ssl_wrapper=context.wrap_socket,
        timeout=120,
    )
    changes = 0
    for menu in job["menus"]:
        path = api.path(*menu["path"].strip("/").split("/"))
        if menu["shape"] == "singleton":
            changes += _settings(path, menu["rows"])
        elif menu["ordered"]:
            changes += _ordered(path, menu)
        else:
            changes += _keyed(path, menu)
    api.close()
    print(f"changes: {changes}")


def _settings(path: Any, expected: list[Row]) -> int:  # noqa: ANN401 - librouteros has no types here
    (found,) = list(path)
    changes = 0
    for row in expected:
        if different := _different(row, found):
            path.update(**different)
            changes += 1
    return changes


def _keyed(path: Any, menu: dict[str, Any]) -> int:  # noqa: ANN401
    found = [row for row in path if not row.get("dynamic")]
    changes, kept = 0, set()
    for row in menu["rows"]:
        match = _match(row, [item for item in found if item[".id"] not in kept], menu["keys"])
        if match is None:
            path.add(**_given(row))
            changes += 1
            continue
        kept.add(match[".id"])
        if different := _different(row, match):
            path.update(**{".id": match[".id"]}, **different)
            changes += 1
    for entry in found if menu["entire"] else ():
        if entry[".id"] not in kept:
            path.remove(entry[".id"])
            changes += 1
    return changes


def _match(row: Row, found: list[Row], keys: list[str]) -> Row | None:
    """Find a row by the keys that are given, and by its comment where that tells several apart."""
    given = [key for key in keys if row.get(key)]
    same = [candidate for candidate in found if all(_same(row[key], candidate.get(key)) for key in given)]
    exact = [candidate for candidate in same if _same(row.get("comment"), candidate.get("comment"))]
    unmarked = [item for item in same if not item.get("comment")]
    return next(iter(exact or unmarked), None)


def _ordered(path: Any, menu: dict[str, Any]) -> int:  # noqa: ANN401
    """First match: rows are recognised by their comment within a chain, and stand where the list says."""
    found = [row for row in path if not row.get("dynamic")]
    matched = [_claim(row, found) for row in menu["rows"]]
    used = {entry[".id"] for entry in matched if entry is not None}
    changes = 0
    for entry in found if menu["entire"] else ():
        if entry[".id"] not in used:
            path.remove(entry[".id"])
            changes += 1
    order = [item[".id"] for item in found if item[".id"] in used]
    for place, (row, entry) in enumerate(zip(menu["rows"], matched, strict=True)):
        before = {"place-before": order[place]} if place < len(order) else {}
        if entry is None:
            order.insert(place, path.add(**_given(row), **before))
            changes += 1
            continue
        if different := _different(row, entry):
            path.update(**{".id": entry[".id"]}, **different)
            changes += 1
        if order[place] != entry[".id"]:
            tuple(path("move", numbers=entry[".id"], destination=order[place]))
            order.remove(entry[".id"])
            order.insert(place, entry[".id"])
            changes += 1
    return changes


def _claim(row: Row, found: list[Row]) -> Row | None:
    for item in found:
        if "claimed" not in item and all(_same(row.get(key), item.get(key)) for key in ("chain", "comment")):
            item["claimed"] = True
            return item
    return None


def _different(row: Row, found: Row) -> Row:
    return {name: value for name, value in _given(row).items() if not _same(value, found.get(name))}


def _given(row: Row) -> Row:
    return {name: "yes" if value is None else value for name, value in row.items()}


def _same(expected: Any, found: Any) -> bool:  # noqa: ANN401
    """Compare a word of ours with what librouteros made of the device's: it casts numbers and truth values."""
    if isinstance(found, bool):
        return expected in (("yes", "true") if found else ("no", "false", "", None))
    return str("" if expected is None else expected) == str("" if found is None else found)


if __name__ == "__main__":
    main()
