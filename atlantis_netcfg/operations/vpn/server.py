"""The VPN server for the commands: one connection, opened when needed, and one form of result.

Every command first disconnects queued members, and records observed sessions at the end.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import ExitCode, NetcfgError, OutcomeUnknown, UsageError, fill_hint
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations.computers import remote_session
from atlantis_netcfg.operations.computers._access import computer_access
from atlantis_netcfg.operations.vpn import live, server_state
from atlantis_netcfg.vpn.identity import Wrap
from atlantis_netcfg.vpn.systems import wrap_of

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.operations.vpn.live import RevocationEvidence
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.authority.model import RevocationResult
    from atlantis_netcfg.vpn.identity import MembershipList


@dataclass(frozen=True, slots=True)
class DeployResult:
    """The state of the server after a command."""

    lines: tuple[str, ...] = ()
    errors: tuple[NetcfgError, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    is_deployed: bool = True
    """Whether the server was observed to match the record."""

    @property
    def exit(self) -> ExitCode:
        """The exit code of the server's part; what is recorded stays recorded in any case."""
        return max((error.exit for error in self.errors), default=ExitCode.DONE)

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {"deployed": self.is_deployed, **self.values}


class Server(Protocol):
    """The VPN server's interface for the commands."""

    def require_current_record(self, authority: Authority, notify: events.Subscriber) -> None:
        """Raise RecordOlder, before anything is signed or sent, if the server is newer than the record."""

    def get_crl(self, notify: events.Subscriber) -> bytes:
        """Return the server's list of revoked certificates, PEM."""

    def deploy(self, authority: Authority, notify: events.Subscriber) -> DeployResult:
        """Bring the server to the recorded state."""

    def disconnect(self, authority: Authority, revocation: RevocationResult, notify: events.Subscriber) -> DeployResult:
        """Disconnect the revoked members, verify that, and bring the server to the recorded state."""


class NoPush:
    """The server with `--no-push`: nothing is contacted."""

    def require_current_record(self, authority: Authority, notify: events.Subscriber) -> None:
        """Do nothing: the check is made when something is sent later."""

    def get_crl(self, notify: events.Subscriber) -> bytes:  # noqa: ARG002 - as Server has it
        """Raise UsageError: the server is not contacted."""
        raise UsageError("the server's revocation list cannot be read without contacting the server")

    def deploy(self, authority: Authority, notify: events.Subscriber) -> DeployResult:  # noqa: ARG002 - as Server has it
        """Return the note that the server still has to be updated."""
        line = "the server was not contacted (`--no-push`): `provision vpn sync` updates it"
        return DeployResult((line,), is_deployed=False)

    def disconnect(self, authority: Authority, revocation: RevocationResult, notify: events.Subscriber) -> DeployResult:  # noqa: ARG002 - as above
        """Return the error that connected members stay connected, so that nobody considers this done."""
        waits = OutcomeUnknown(
            f"{arg(join(', ', revocation.members))}: on the revocation list, but the server does not have it yet "
            "(`--no-push`): open sessions continue",
            hint=f"`provision vpn sync` ends their sessions: {arg(join(', ', authority.membership().queued_names))}",
        )
        return DeployResult(errors=(waits,), is_deployed=False)


Opener = Callable[[], "remote_session.ServerLink"]
_SYNC_HINT = "everything is recorded; to update the server: `provision vpn sync`"


def over_ssh(inventory: Inventory, request: Request, otherwise: str = "") -> Opener:
    """Return a function that opens the link to the server; raise UsageError for example values.

    `otherwise`: what else can be typed then.
    """
    if inventory.pilot.example_values and not request.rehearsed:
        raise UsageError(
            "the inventory still contains example values, so it names no real server",
            hint=f"replace them and set `example_values: false` in group_vars/all/pilot.yml{arg(otherwise)}",
        )
    host = inventory.hosts[inventory.pilot.vpn.server]
    return lambda: remote_session.SshLink(host.name, computer_access(inventory, host, request))


@dataclass(frozen=True, slots=True)
class RemoteServer:
    """The VPN server in the inventory."""

    inventory: Inventory
    opener: Opener
    who: str
    second_look_s: float = 1.0
    """Seconds from revocation to a second check: a handshake in progress may have read the old list (facts 5)."""
    _away: list[remote_session.ServerAway] = field(default_factory=list, init=False)
    """Why the server was unreachable when it was compared with the record; later steps do not wait for it again."""

    def require_current_record(self, authority: Authority, notify: events.Subscriber = events.ignore) -> None:
        """Raise RecordOlder if the server's list has entries that the record does not.

        An unreachable server does not prevent the recording of a revocation: it compares every list sent later with its
        own.
        """
        try:
            with self.link(notify) as link:
                state = live.observe(link)
        except remote_session.ServerAway as away:
            self._away.append(away)
        except NetcfgError:
            return
        else:
            live.check_record(authority, state)

    def get_crl(self, notify: events.Subscriber = events.ignore) -> bytes:
        """Return the server's list; raise ServerAway, AnswerLost, or ServerRefusal if it has none of its CA."""
        with self.link(notify) as link:
            crl = live.observe(link).crl
        if crl is None or not crl.is_signed:
            raise remote_session.ServerRefusal(
                "the server has no revocation list of its own authority", hint="there is nothing to take over"
            )
        return crl.pem.encode()

    def deploy(self, authority: Authority, notify: events.Subscriber = events.ignore) -> DeployResult:
        """Bring the server to the recorded state, and record observed sessions."""
        if self._away:
            return self._outstanding(self._away[0])
        try:
            with self.link(notify) as link:
                queue = live.finish_revocations(self.inventory, authority, link, self.who)
                self._say(notify, "members, revocation list and firewall", events.Stage.APPLYING)
                push_result = live.push(self.inventory, authority, link)
                self._say(notify, "connected members", events.Stage.VERIFYING)
                more = self._record_sessions(authority, link)
        except NetcfgError as error:
            return self._outstanding(error)
        changes = [*push_result.changes, *more]
        values: dict[str, Any] = {"changes": changes, "queue": queue.as_json() if queue is not None else None}
        lines = [msg(f"  on the server: {arg(change)}") for change in changes] or [
            "  the server was already up to date"
        ]
        return DeployResult(
            tuple(self._evidence_lines(queue) + lines + [f"  {item}" for item in push_result.notes]),
            self._remaining_errors(queue),
            values,
        )

    def disconnect(
        self, authority: Authority, revocation: RevocationResult, notify: events.Subscriber = events.ignore
    ) -> DeployResult:
        """End the revoked members' sessions first and verify that; then apply the rest of the record."""
        names = tuple(dict.fromkeys([*revocation.common_names, *authority.membership().queued_names]))
        if self._away:
            return self._outstanding(self._away[0], cut=revocation.members)
        try:
            with self.link(notify) as link:
                self._say(
                    notify, msg(f"ending sessions of {arg(join(', ', revocation.members))}"), events.Stage.APPLYING
                )
                evidence = live.revoke_live(self.inventory, authority, link, names)
                cut = time.monotonic()
                push_result = live.push(self.inventory, authority, link)
                self._say(notify, "checking again", events.Stage.VERIFYING)
                time.sleep(max(0.0, self.second_look_s - (time.monotonic() - cut)))
                evidence = live.verify(link, evidence)
                if evidence.is_confirmed:
                    authority.confirm_revocations(names, self.who)
        except NetcfgError as error:
            return self._outstanding(error, cut=revocation.members)
        values = {"evidence": evidence.as_json(), "changes": list(push_result.changes)}
        return DeployResult(
            tuple(self._evidence_lines(evidence)),
            self._remaining_errors(evidence),
            values,
            is_deployed=evidence.is_confirmed,
        )

    def _record_sessions(self, authority: Authority, link: remote_session.ServerLink) -> Sequence[str]:
        """Record observed sessions; return the resulting changes on the server."""
        _, push_result = live.note_seen(self.inventory, authority, link, live.observe(link), self.who)
        return push_result.changes if push_result is not None else ()

    @contextmanager
    def link(self, notify: events.Subscriber) -> Iterator[remote_session.ServerLink]:
        """Open the link for the duration of the block."""
        self._say(notify, "", events.Stage.CONNECTING)
        server_link = self.opener()
        try:
            yield server_link
        finally:
            server_link.close()
        self._say(notify, "", events.Stage.DONE)

    def _say(self, notify: events.Subscriber, message: str, stage: events.Stage) -> None:
        notify(events.Event(self.inventory.pilot.vpn.server, stage, message))

    @staticmethod
    def _evidence_lines(evidence: RevocationEvidence | None) -> list[str]:
        """Return the evidence as text: steps with their times in milliseconds, and the server's report."""
        if evidence is None:
            return []
        lines = [msg(f"  {arg(at):8.1f} ms  {arg(step)}") for step, at in evidence.steps]
        lines += [
            msg(
                f"  ended      {arg(session.common_name)}, {arg(session.address or 'handshake not complete')}, from "
                f"{arg(session.real)}"
            )
            for session in evidence.ended
        ]
        whole = msg(f"{arg(1000 * evidence.seconds):.0f} ms including the round trip")
        words = "verified: no session, and none of their traffic passes" if evidence.is_confirmed else "NOT verified"
        return [*lines, msg(f"  {arg(words)} ({arg(whole)})"), *(f"  {item}" for item in evidence.notes)]

    @staticmethod
    def _remaining_errors(evidence: RevocationEvidence | None) -> tuple[NetcfgError, ...]:
        if evidence is None or evidence.is_confirmed:
            return ()
        names = join(", ", evidence.common_names)
        return (
            OutcomeUnknown(
                f"the server has not confirmed that these are cut off: {arg(names)}: {arg(join('; ', evidence.left))}",
                hint="`provision vpn sync` tries again and checks",
            ),
        )

    @property
    def site(self) -> str:
        """The site of the server."""
        return self.inventory.hosts[self.inventory.pilot.vpn.server].site

    def _outstanding(self, error: NetcfgError, cut: Sequence[str] = ()) -> DeployResult:
        """Return the result for a server that still has to be updated; record and files are kept."""
        who = msg(
            f"{arg(join(', ', cut))}: recorded and on the revocation list; open sessions may continue. " if cut else ""
        )
        hint = msg(f"{arg(fill_hint(error.hint, site=self.site))}\n{arg(_SYNC_HINT)}") if error.hint else _SYNC_HINT
        return DeployResult(errors=(Outstanding(error, f"{who}{error}", hint),), is_deployed=False)


class Outstanding(NetcfgError):
    """The request is recorded, but not on the server; the exit code is that of the cause."""

    def __init__(self, cause: NetcfgError, message: str, hint: str) -> None:
        super().__init__(message, hint=hint)
        self.exit = cause.exit


@dataclass(frozen=True, slots=True)
class StatusItem:
    """One line of the status."""

    verdict: events.Verdict
    message: str
    hint: str | None = None

    def as_json(self) -> dict[str, str | None]:
        """Return JSON-able data."""
        return {"verdict": self.verdict.value, "message": self.message, "hint": self.hint}


@dataclass(frozen=True, slots=True)
class VpnStatus:
    """The status of the VPN."""

    items: tuple[StatusItem, ...]
    state: server_state.ServerState | None
    """None: the server was not reached, or was not to be queried."""

    @property
    def exit(self) -> ExitCode:
        """The exit code: 6 if something is wrong, 5 if the server does not respond."""
        verdict = events.worst(item.verdict for item in self.items)
        if verdict is events.Verdict.FAIL:
            return ExitCode.CHECKS_FAILED
        return ExitCode.UNKNOWN if verdict is events.Verdict.INCONCLUSIVE else ExitCode.DONE

    def server_json(self) -> dict[str, Any] | None:
        """Return the server's state as JSON-able data."""
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


def vpn_status(
    inventory: Inventory,
    authority: Authority,
    server: RemoteServer | None,
    notify: events.Subscriber = events.ignore,
) -> VpnStatus:
    """Check the record and, unless it is None, the server; raise CorruptLedgerError.

    The server is read before anything is sent to it, so that a file changed there is reported and not silently
    corrected. A server that does not respond gets no verdict.
    """
    result = list(_record(inventory, authority))
    state = None
    if server is None:
        result.append(StatusItem(events.Verdict.SKIP, "the server was not contacted (`--no-push`)"))
    else:
        try:
            with server.link(notify) as link:
                state = server_state.observe(link)
                result += _server(authority, server, link, state)
        except NetcfgError as error:
            verdict = events.Verdict.INCONCLUSIVE if error.exit is ExitCode.UNKNOWN else events.Verdict.FAIL
            result.append(
                StatusItem(
                    verdict, msg(f"the server: {arg(error)}"), error.hint and fill_hint(error.hint, site=server.site)
                )
            )
    return VpnStatus((*result, *_queue_items(authority)), state)


def _record(inventory: Inventory, authority: Authority) -> Iterator[StatusItem]:
    """Yield the problems that the authority finds in its record, each with a remedy."""
    problems = authority.check()
    for problem in problems:
        yield StatusItem(events.Verdict.FAIL, problem)
    if not problems:
        membership = authority.membership()
        yield from unsuitable_keys(inventory, membership)
        good = sum(1 for member in membership.members.values() if member.good)
        yield StatusItem(
            events.Verdict.PASS,
            msg(
                f"the record matches its signature, certificates and revocation list: {arg(good)} of "
                f"{arg(len(membership.members))} members are admitted, list {arg(membership.crl_number)} is valid "
                f"until {arg(membership.crl_next_update):%Y-%m-%d}"
            ),
        )


def unsuitable_keys(inventory: Inventory, membership: MembershipList) -> Iterator[StatusItem]:
    """Yield members whose key does not fit the server's settings: the end of the shared key, or the cookie."""
    vpn, members = inventory.pilot.vpn, [member for member in membership.members.values() if member.good]
    shared_key_members = [member.name for member in members if member.good[-1].wrap is Wrap.TLS_CRYPT]
    if vpn.shared_key_until is not None and shared_key_members:
        yield StatusItem(
            events.Verdict.WARN,
            msg(
                f"{arg(join(', ', shared_key_members))}: no new session after {arg(vpn.shared_key_until)}, "
                "the last day of the shared key"
            ),
            msg(
                f"if they have OpenVPN 2.5 or later: `provision vpn renew name={arg(shared_key_members[0])} "
                "wrap=tls-crypt-v2`"
            ),
        )
    silent = [
        member.name
        for member in members
        if member.good[-1].wrap is Wrap.TLS_CRYPT_V2 and wrap_of(inventory, member) is Wrap.TLS_CRYPT
    ]
    if vpn.force_cookie and silent:
        yield StatusItem(
            events.Verdict.WARN,
            msg(
                f"{arg(join(', ', silent))}: the server responds to their key only if their OpenVPN is 2.6 or later "
                "(`force_cookie`)"
            ),
            msg(f"`provision vpn renew name={arg(silent[0])}` creates a key that works with any OpenVPN"),
        )


def _server(
    authority: Authority, server: RemoteServer, link: remote_session.ServerLink, state: server_state.ServerState
) -> Iterator[StatusItem]:
    differs = server_state.drift(state, live.desired_files(server.inventory, authority), authority.membership())
    try:
        live.check_record(authority, state)
    except remote_session.StaleRecord as older:
        yield StatusItem(events.Verdict.FAIL, str(older), older.hint)
        yield from (StatusItem(events.Verdict.FAIL, differ) for differ in differs)
        return
    for item in differs:
        yield StatusItem(events.Verdict.FAIL, item, "`provision vpn sync` updates the server from the record")
    if not differs:
        up = sum(session.is_up for session in state.sessions)
        yield StatusItem(
            events.Verdict.PASS,
            msg(f"the server matches the record; {arg(up)} sessions, OpenVPN {arg(state.version or 'unknown')}"),
        )
    if not state.ready:
        return
    sighting, _ = live.note_seen(server.inventory, authority, link, state, server.who)
    for name in sighting.strangers:
        yield StatusItem(
            events.Verdict.FAIL,
            msg(f"{arg(name)} has a session but is not in the record"),
            "is this the newest copy of the record?",
        )
    up_now = {session.common_name for session in state.sessions if session.is_up}
    for name in sighting.withdrawn:
        if name in up_now:
            yield StatusItem(
                events.Verdict.FAIL,
                msg(f"{arg(name)} is connected although its access was withdrawn"),
                "`provision vpn sync` ends its session",
            )
        else:
            yield StatusItem(
                events.Verdict.WARN, msg(f"{arg(name)} was seen after its access was withdrawn; it has no session now")
            )
    for name in sighting.superseded_names:
        yield StatusItem(events.Verdict.PASS, msg(f"{arg(name)} is retired: its successor was seen"))
    evidence = live.finish_revocations(server.inventory, authority, link, server.who)
    if evidence is not None and evidence.is_confirmed:
        yield StatusItem(
            events.Verdict.PASS, msg(f"cut off, as confirmed by the server: {arg(join(', ', evidence.common_names))}")
        )


def _queue_items(authority: Authority) -> Iterator[StatusItem]:
    queue = authority.membership().queued_names
    if queue:
        yield StatusItem(
            events.Verdict.FAIL,
            msg(f"revoked, but the server has not confirmed that they are cut off: {arg(join(', ', queue))}"),
            "run `provision vpn sync` when the server is reachable",
        )
