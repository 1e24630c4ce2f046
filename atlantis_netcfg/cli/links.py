"""`provision links`: how every link of a site is, which one carries the traffic, and what is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, ASK_VAULT_PASS, INVENTORY, JSON, ONLY, VIA, Command, Flag, Word

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.links.look import LinksStatus
    from atlantis_netcfg.report.links import LinksReport

COMMAND = Command(
    "links",
    "say how every link of a site is, which one carries the traffic, and what is wrong",
    words=(
        Word("site", "the site", required=True, example="coastal"),
        ONLY,
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("rehearse", "the same with emulated devices of the site, configured first"),
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "Nothing is changed, and nothing is sent over a satellite. Exit code 6 says that a link fails or cannot be "
        "seen, or a device does not answer, 0 that all is well but for warnings, 7 that nobody was asked."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Ask every box of the site's links at once, and tell."""
    import json

    from atlantis_netcfg.cli._session import session

    _one_site(arguments.word("site"))
    with session(arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via")) as opened:
        if opened.rehearsal is not None:
            _configure(opened)
        report = _report(opened, _look(opened))
    print(json.dumps(report.as_json(), ensure_ascii=False) if opened.as_json else report.as_text())
    return report.exit


def _one_site(site: str) -> None:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.declaration import ALL

    if site == ALL:
        raise UsageError("`provision links` looks at one site at a time", hint="type its name: `site=coastal`")


def _configure(opened: Session) -> None:
    """Bring the emulated devices to their declared state: fresh from `provision adopt` they have no links.

    A check that fails is for the look to tell.
    """
    from atlantis_netcfg.core.errors import ExitCode, NetcfgError
    from atlantis_netcfg.operations import Mode

    report = opened.perform(Mode.APPLY)
    if report.exit not in {ExitCode.DONE, ExitCode.CHECKS_FAILED, ExitCode.NOTHING}:
        raise NetcfgError(f"the emulated devices could not be configured:\n{report.as_text()}")


def _look(opened: Session) -> LinksStatus:
    """Look, once it is agreed what the looking may cost."""
    import asyncio

    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.links.look import look
    from atlantis_netcfg.operations.request import refuse_examples

    refuse_examples(opened.declaration, rehearsed=opened.rehearsed)
    request = opened.paid(opened.request(Mode.DRIFT))
    with progress(quiet=opened.as_json) as notify:
        return asyncio.run(look(opened.declaration, opened.site, opened.hosts, request, notify))


def _report(opened: Session, status: LinksStatus) -> LinksReport:
    title = opened.declaration.sites[opened.site].title
    twins = opened.rehearsal
    missing = twins.not_rehearsed if twins is not None else ()
    return status.report(opened.site, title, rehearsed=opened.rehearsed, not_rehearsed=missing)
