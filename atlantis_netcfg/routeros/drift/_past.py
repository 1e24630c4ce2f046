"""Since when: the device now against the state that a run has read back last."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros import snapshot
from atlantis_netcfg.routeros.drift._model import DriftKind, Since
from atlantis_netcfg.routeros.drift._raw import alone, content, marked
from atlantis_netcfg.routeros.menus import Shape

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Mapping, Sequence
    from datetime import datetime

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.drift._raw import Raw
    from atlantis_netcfg.routeros.menus import Menu

__all__ = ["Past"]

_Verdict = tuple[Since, str]
_NO_SECRETS = (Since.UNKNOWN, "a confirmed state holds no secrets")


@dataclass(frozen=True, slots=True)
class _Index:
    """The rows of one menu: by their keys, or by their content where they have none, and by our words about them."""

    by_self: Mapping[tuple[str, ...], Mapping[str, str]]
    by_mark: Mapping[Hashable, Mapping[str, str]]

    @classmethod
    def of(cls, menu: Menu, rows: Sequence[Mapping[str, str]]) -> _Index:
        key = menu.identity if menu.keys else lambda values: content(menu, values)
        return cls({key(row): row for row in reversed(rows)}, alone(marked, rows))


@dataclass(frozen=True, slots=True)
class Past:
    """A confirmed state."""

    run: str
    at: datetime
    rows: Mapping[str, tuple[Mapping[str, str], ...]]
    """By menu; only what is not at its default."""
    indices: dict[str, _Index] = field(default_factory=dict)
    """By menu, made when a menu is asked for."""

    @classmethod
    def read(cls, run: str, at: datetime, text: str) -> Past:
        """Read what `snapshot.write` has written. Raises RscError."""
        state = snapshot.read(text, f"the state that run {run} confirmed")
        return cls(run, at, {path: tuple(item.given for item in items) for path, items in state.items.items()})

    def since(self, menu: Menu, raw: Raw, rows: Sequence[Row]) -> _Verdict:
        """Return when a difference came about, and why nobody can tell; `rows` are those of the menu now."""
        if menu.path not in self.rows:
            return Since.UNKNOWN, f"run {self.run} did not read this menu"
        if raw.kind is DriftKind.ORDER and raw.found is not None:
            return self._order(menu, raw.found, rows)
        if raw.found is None:
            there = raw.declared is not None and self._then(menu, raw.declared) is not None
            return (Since.AFTER if there else Since.ALREADY), ""
        then = self._then(menu, raw.found)
        if then is None:
            return Since.AFTER, ""
        if raw.kind is DriftKind.CHANGED:
            return _changed(menu, raw, then)
        return (Since.ALREADY if content(menu, then) == content(menu, raw.found) else Since.AFTER), ""

    def _then(self, menu: Menu, values: Mapping[str, str]) -> Mapping[str, str] | None:
        """Return the row as it was then: settings are always there, and given rows also at their defaults."""
        there = self.rows[menu.path]
        if menu.shape is Shape.SINGLETON:
            return there[0] if there else {}
        if menu.path not in self.indices:
            self.indices[menu.path] = _Index.of(menu, there)
        index = self.indices[menu.path]
        found = index.by_self.get(menu.identity(values) if menu.keys else content(menu, values))
        if found is None and menu.keys and (menu.shape is Shape.FIXED or menu.is_stock(values)):
            return {key: values[key] for key in menu.keys if key in values}
        return found if found is not None else index.by_mark.get(marked(values))

    def _order(self, menu: Menu, found: Row, rows: Sequence[Row]) -> _Verdict:
        """Compare the order of what stood in the row's list then and stands there now."""
        chain = menu.form(menu.chain, found) if menu.chain else ""
        then = _chain(menu, self.rows[menu.path], chain)
        now = _chain(menu, [row for row in rows if menu.is_touchable(row)], chain)
        both = set(then) & set(now)
        same = [entry for entry in then if entry in both] == [item for item in now if item in both]
        return (Since.ALREADY if same else Since.AFTER), ""


def _changed(menu: Menu, raw: Raw, then: Mapping[str, str]) -> _Verdict:
    names = [name for name in raw.differing(menu) if not menu.by_name[name].secret]
    if not names:
        return _NO_SECRETS
    names = [name for name in names if (menu.path, name) not in snapshot.OF_THE_BOX]
    if not names:
        return Since.UNKNOWN, "a confirmed state leaves out what a device gives itself"
    found = raw.found or {}
    same = all(menu.form(name, found) == menu.form(name, then) for name in names)
    return (Since.ALREADY if same else Since.AFTER), ""


def _chain(menu: Menu, rows: Iterable[Mapping[str, str]], chain: str) -> list[tuple[str, ...]]:
    return [content(menu, row) for row in rows if not menu.chain or menu.form(menu.chain, row) == chain]
