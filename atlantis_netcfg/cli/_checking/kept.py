"""The checklists that are kept on this computer, for the commands that tell of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist import books
from atlantis_netcfg.cli._checking.opening import folder_of
from atlantis_netcfg.core import paths
from atlantis_netcfg.core.errors import NothingMatched
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.journal import Store

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.checklist import Kept
    from atlantis_netcfg.checklist.report import Document


def store(*, rehearsed: bool) -> Store:
    """Where they are kept."""
    return Store(paths.state_dir(), rehearsed=rehearsed)


def sites_with(where: Store) -> tuple[str, ...]:
    """The sites that have a checklist there."""
    if not where.root.is_dir():
        return ()
    return tuple(sorted(path.name for path in where.root.iterdir() if books(folder_of(where, path.name))))


def kept_of(where: Store, site: str, *, rehearsed: bool) -> tuple[Kept, ...]:
    """The checklists of a site, newest last. Raises NothingMatched where there are none."""
    known = sites_with(where)
    if site in known:
        return books(folder_of(where, site))
    near = nearest(site, known)
    begins = "" if near else f"; `provision check site={site}{' --rehearse' if rehearsed else ''}` begins one"
    other = "" if rehearsed or site not in sites_with(store(rehearsed=True)) else "; add --rehearsed for rehearsed ones"
    raise NothingMatched(
        f"there is no {'rehearsed ' if rehearsed else ''}checklist of `{site}`",
        hint=_meant(site, known, "there are checklists of") + (other or begins),
    )


def run_of(kept: Sequence[Kept], run: str | None) -> Kept:
    """One by its name, else the newest. Raises NothingMatched."""
    if run is None:
        return kept[-1]
    for entry in kept:
        if entry.run == run:
            return entry
    raise NothingMatched(
        f"there is no checklist {run}", hint=_meant(run, [item.run for item in kept[-5:]], "the latest")
    )


def _meant(word: str, known: Iterable[str], what: str) -> str:
    every = list(known)
    near = nearest(word, every)
    return f"did you mean `{near}`?" if near else f"{what}: {', '.join(every) or 'none'}"


def as_json(document: Document) -> dict[str, Any]:
    """The document, and how the command ends."""
    return {**document.model_dump(mode="json"), "exit": int(document.exit)}


def pages_in(folder: Path) -> Iterator[str]:
    """Where the pages of a checklist are, for people."""
    if (folder / "report.html").exists():
        yield f"report: {folder / 'report.html'} (report.pdf and junit.xml are beside it)"
