"""`provision restore`: put a confirmed state of a device on the one that stands in for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    REMOVE_FOREIGN,
    UNPROTECTED,
    VERBOSE,
    VIA,
    Command,
    Flag,
    Word,
)

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.journal import Confirmed

COMMAND = Command(
    "restore",
    "put the state that a run has read back on a replacement device",
    words=(
        Word("device", "the device that is replaced", required=True, example="coastal-router"),
        Word("site", "its site, if you want that checked", example="coastal"),
        Word("to", "the run whose state it gets, as `provision runs` lists it, or `latest`", True, example="latest"),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("plan", "show what would change and what it costs, change nothing", harmless=True),
        Flag("rehearse", "the same on an emulated device, fresh from `provision adopt`", harmless=True),
        Flag("yes", "do not ask before changing the device"),
        ACCEPT_COST,
        UNPROTECTED,
        REMOVE_FOREIGN,
        ASK_VAULT_PASS,
        JSON,
        VERBOSE,
    ),
    details=(
        "Meet the replacement first: `provision adopt --replaced` gives it our user and a certificate of its own.\n"
        "Secrets are not in a saved state: they are taken from the declaration, and what it lacks is named."
    ),
    changes=True,
    plays=True,
)


def run(arguments: Arguments) -> ExitCode:
    """Find the state, show what it changes on the device, ask, apply, read back."""
    from atlantis_netcfg.cli._session import session
    from atlantis_netcfg.declaration import ALL
    from atlantis_netcfg.operations.restore import confirmed_state

    rehearsed = arguments.flag("rehearse")
    with session(
        arguments,
        rehearse=rehearsed,
        via=arguments.optional("via"),
        site=arguments.optional("site") or ALL,
        only=[arguments.word("device")],
    ) as opened:
        (host,) = opened.hosts
        opened.site = host.site
        state = confirmed_state(opened.state, host, arguments.word("to"), rehearsed=rehearsed)
        opened.restore = state.run
        _tell(opened, state)
        if arguments.flag("plan"):
            report = opened.plan()
        elif opened.rehearsal is not None:
            from atlantis_netcfg.cli._rehearse import rehearse

            report = rehearse(opened, opened.rehearsal)
        else:
            report = opened.change(ask=not arguments.flag("yes"))
    return opened.close(report)


def _tell(opened: Session, state: Confirmed) -> None:
    """Say what is put where: after the first run on the replacement, `latest` is a state of its own."""
    if opened.as_json:
        return
    run = opened.store.run(opened.site, state.run) if not opened.rehearsed else None
    when = f"{state.at:%Y-%m-%d %H:%M} UTC"
    print(f"{opened.hosts[0].name}: the state that run {state.run} read back at {when}", flush=True)
    if run is not None and run.started is not None and run.started.revision != opened.declaration.revision:
        print(f"  the inventory has changed: `provision site={opened.site}` brings what it declares now", flush=True)
