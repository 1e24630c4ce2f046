"""How it stands with the VPN: what the record says of itself, what the server has, and what differs between the two.

The server is looked at before anything is brought to it, so that a file that somebody has changed there is told and
not put right in passing. Silence of the server is no verdict on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, complete
from atlantis_netcfg.core.events import Subscriber, ignore
from atlantis_netcfg.core.verdicts import Verdict, worst
from atlantis_netcfg.operations.vpn import live

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.operations.vpn.link import ServerLink
    from atlantis_netcfg.operations.vpn.live import ServerState
    from atlantis_netcfg.operations.vpn.server import Connected
    from atlantis_netcfg.vpn.authority.authority import Authority


@dataclass(frozen=True, slots=True)
class StatusItem:
    """One line of the status."""

    verdict: Verdict
    message: str
    hint: str | None = None

    def as_json(self) -> dict[str, str | None]:
        """For programs."""
        return {"verdict": self.verdict.value, "message": self.message, "hint": self.hint}


@dataclass(frozen=True, slots=True)
class VpnStatus:
    """The status of the VPN."""

    items: tuple[StatusItem, ...]
    state: ServerState | None
    """None: the server was not reached, or was not to be asked."""

    @property
    def exit(self) -> ExitCode:
        """6 where something is seen to be wrong, 5 where the server is silent."""
        found = worst(item.verdict for item in self.items)
        if found is Verdict.FAIL:
            return ExitCode.CHECKS_FAILED
        return ExitCode.UNKNOWN if found is Verdict.INCONCLUSIVE else ExitCode.DONE

    def server_json(self) -> dict[str, Any] | None:
        """The server for programs."""
        if self.state is None:
            return None
        crl = self.state.crl
        return {
            "version": self.state.version,
            "package": self.state.package,
            "sessions": [session.as_json() for session in self.state.sessions],
            "asked": self.state.is_live,
            "list": None if crl is None else {"number": crl.number, "ends": crl.ends.isoformat()},
        }


def vpn_status(authority: Authority, server: Connected | None, notify: Subscriber = ignore) -> VpnStatus:
    """Look at the record, and at the server unless there is None. Raises LedgerDamaged."""
    result = list(_record(authority))
    state = None
    if server is None:
        result.append(StatusItem(Verdict.SKIP, "the server was not asked (`--no-push`)"))
    else:
        try:
            with server.link(notify) as link:
                state = live.observe(link)
                result += _server(authority, server, link, state)
        except NetcfgError as error:
            verdict = Verdict.INCONCLUSIVE if error.exit is ExitCode.UNKNOWN else Verdict.FAIL
            result.append(
                StatusItem(verdict, f"the server: {error}", error.hint and complete(error.hint, site=server.site))
            )
    return VpnStatus((*result, *_queued(authority)), state)


def _record(authority: Authority) -> Iterator[StatusItem]:
    """What the authority finds wrong with itself, each with what helps."""
    problems = authority.check()
    for problem in problems:
        yield StatusItem(Verdict.FAIL, problem)
    if not problems:
        membership = authority.membership()
        good = sum(1 for member in membership.members.values() if member.good)
        yield StatusItem(
            Verdict.PASS,
            f"the record agrees with its signature, certificates and list: {good} of {len(membership.members)} members "
            f"are admitted, list {membership.crl_number} is good until {membership.crl_next_update:%Y-%m-%d}",
        )


def _server(authority: Authority, server: Connected, link: ServerLink, state: ServerState) -> Iterator[StatusItem]:
    differs = live.drift(state, live.desired_files(server.declaration, authority), authority.membership())
    try:
        live.check_record(authority, state)
    except live.RecordOlder as older:
        yield StatusItem(Verdict.FAIL, str(older), older.hint)
        yield from (StatusItem(Verdict.FAIL, differ) for differ in differs)
        return
    for item in differs:
        yield StatusItem(Verdict.FAIL, item, "`provision vpn sync` brings the server to what is recorded")
    if not differs:
        up = sum(session.is_up for session in state.sessions)
        yield StatusItem(
            Verdict.PASS, f"the server is as recorded; {up} sessions, OpenVPN {state.version or 'unknown'}"
        )
    if not state.ready:
        return
    sighting, _ = live.note_seen(server.declaration, authority, link, state, server.who)
    for name in sighting.strangers:
        yield StatusItem(
            Verdict.FAIL, f"{name} has a session, and is not in the record", "is this the newest copy of it?"
        )
    up_now = {session.common_name for session in state.sessions if session.is_up}
    for name in sighting.withdrawn:
        if name in up_now:
            yield StatusItem(
                Verdict.FAIL, f"{name} is connected, and was put out", "`provision vpn sync` ends its session"
            )
        else:
            yield StatusItem(Verdict.WARN, f"{name} was seen after it was put out; it has no session now")
    for name in sighting.superseded:
        yield StatusItem(Verdict.PASS, f"{name} is retired: its successor was seen")
    evidence = live.finish_revocations(server.declaration, authority, link, server.who)
    if evidence is not None and evidence.confirmed:
        yield StatusItem(Verdict.PASS, f"dead, by the server's own word: {', '.join(evidence.common_names)}")


def _queued(authority: Authority) -> Iterator[StatusItem]:
    queued = authority.membership().queued
    if queued:
        yield StatusItem(
            Verdict.FAIL,
            f"revoked, and not confirmed dead by the server: {', '.join(queued)}",
            "`provision vpn sync` when the server can be reached",
        )
