"""Import of an identity into a router: read the router, import what is missing, and read it back.

The old tunnel stays up until the new one is on the router. The order is: certificate, then configuration under the name
that the import gives it, then the old interface is removed and the new one gets its name in one command. Each file that
contains a key is removed before the next step, whatever the router replied.
"""

from __future__ import annotations

import asyncio
import re
from contextlib import asynccontextmanager
from dataclasses import dataclass
from ipaddress import IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import DeviceError, OutcomeUnknown
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros import api
from atlantis_netcfg.vpn import routeros

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterator, Mapping
    from datetime import datetime

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.vpn.identity import Identity

PEM, PROFILE = "atlantis-vpn.pem", "atlantis-vpn.ovpn"
"""Files on the router, which exist for seconds."""
_MENU, _CERTIFICATES = "/interface/ovpn-client", "/certificate"
_IMPORT_PREFIX = "ovpn-import"
"""Name prefix of an imported interface, before the second of its creation (seen in others' exports)."""
_TRIES, _PAUSE_S = 15, 1.0
"""A real router imports in the background: scripts by others wait five seconds for it."""
_DATE = re.compile(r"\d{4}-\d\d-\d\d")
"""Date format of RouterOS 7.10 and later."""
_SAME = {"true": "yes", "false": "no"}


@dataclass(frozen=True, slots=True)
class RouterObservation:
    """One observation of a router."""

    interface: Mapping[str, str] | None
    """Row of the interface with the declared name; None: missing."""
    certificate: Mapping[str, str] | None
    """Row of this identity's certificate; None: the certificate or its key is missing."""
    authority: bool
    """Whether the authority's certificate is present."""
    conflict: Mapping[str, str] | None
    """Different certificate with the declared name; None: no conflict."""
    stale: tuple[str, ...]
    """`.id`s of interfaces left by our interrupted runs."""
    files: tuple[str, ...]
    changes: tuple[str, ...]
    notes: tuple[str, ...]
    by_tunnel: bool
    """Whether our session uses the tunnel that would be replaced."""


@dataclass(frozen=True, slots=True)
class RouterImport:
    """The input of an import."""

    name: str
    site: str
    endpoint: api.Endpoint
    tunnel: routeros.Tunnel
    identity: Identity
    profile: Secret
    is_rehearsal: bool
    notify: events.Subscriber

    @property
    def mark(self) -> str:
        """The MAC address that marks the interface as having this identity's keys."""
        return routeros.mark(self.identity)

    async def look(self) -> RouterObservation:
        """Observe the router; change nothing. Raises RouterTooOld, and the errors of a session."""
        self._say(events.Stage.CONNECTING, msg(f"to {arg(self.endpoint)}"))
        session = await api.Session.open(self.endpoint)
        try:
            return await self._look(session)
        finally:
            await session.close()

    async def carry_out(self) -> RouterObservation:
        """Import what an observation finds missing, and return that observation. Raises DeviceError, OutcomeUnknown."""
        session = await api.Session.open(self.endpoint)
        try:
            observation = await self._look(session)
            if observation.by_tunnel:
                raise DeviceError(
                    f"you reach {arg(self.name)} through {arg(self.tunnel.name)}, which would go down with your "
                    "session",
                    hint=(
                        "work at the site, on the management port: the old certificate stays valid until the new "
                        "one works"
                    ),
                )
            try:
                await self._import(session, observation)
            except api.SessionLost as lost:
                raise OutcomeUnknown(
                    f"connection to {arg(self.name)} lost while its tunnel was imported: {arg(lost)}",
                    hint="run the same command again: it continues from there and removes leftover files",
                ) from lost
            remaining_changes = (await self._look(session)).changes
            if remaining_changes:
                raise OutcomeUnknown(
                    f"{arg(self.name)} differs from what was imported: {arg(join('; ', remaining_changes))}"
                )
            self._say(events.Stage.CONFIRMED, msg(f"{arg(self.tunnel.name)}: tunnel imported"))
            return observation
        finally:
            await session.close()

    # --- looking ---------------------------------------------------------------------------------------------------

    async def _look(self, session: api.Session) -> RouterObservation:
        reads = (
            api.Command("/system/resource/print", ((".proplist", "version"),)),
            api.Command(f"{_MENU}/print"),
            api.Command(f"{_CERTIFICATES}/print", ((".proplist", ".id,name,fingerprint,private-key"),)),
            api.Command("/file/print", ((".proplist", "name"),), (f"?name={PEM}", f"?name={PROFILE}", "?#|")),
            api.Command("/ip/route/print", ((".proplist", "dst-address"),), (f"?gateway={self.tunnel.name}",)),
            api.Command("/user/active/print", ((".proplist", "name,address,via"),)),
            api.Command("/system/clock/print", ((".proplist", "date"),)),
        )
        resource, *others = await session.flight(reads)
        self._check_version(resource)
        interfaces, certificates, files, routes, active, clock = (reply.check().rows for reply in others)
        interface = next((row for row in interfaces if row.get("name") == self.tunnel.name), None)
        row_by_fingerprint = {row.get("fingerprint", "").lower(): row for row in certificates}
        certificate = row_by_fingerprint.get(self.identity.certificate.sha256)
        if certificate is not None and certificate.get("private-key") not in {"true", "yes"}:
            certificate = None
        conflict = next((row for row in certificates if row.get("name") == self.tunnel.certificate), None)
        if conflict is not None and certificate is not None and conflict.get(".id") == certificate.get(".id"):
            conflict = None
        stale = tuple(row[".id"] for row in interfaces if self._left_by_us(row))
        there = tuple(row["name"] for row in files)
        changes = tuple(self._changes(interface, certificate, stale, there))
        is_replacement = interface is not None and not self._is_marked(interface)
        return RouterObservation(
            interface=interface,
            certificate=certificate,
            authority=_ca_fingerprint(self.identity) in row_by_fingerprint,
            conflict=conflict,
            stale=stale,
            files=there,
            changes=changes,
            notes=((msg(_REPLACEMENT_NOTE.format(site=arg(self.site))),) if is_replacement else ())
            + tuple(self._wrong_clock(clock)),
            by_tunnel=is_replacement and self._is_session_over_tunnel(routes, active),
        )

    def _check_version(self, resource: api.Reply) -> None:
        about = next(iter(resource.check().rows), {})
        try:
            version = Version.parse(about.get("version", ""))
        except ValueError:
            raise DeviceError(
                f"{arg(self.name)} does not report its RouterOS version: {arg(about.get('version', ''))!r}"
            ) from None
        upgrade = f"`provision device upgrade site={self.site} device={self.name} packages=FILE.npk`"
        routeros.check_version(version, where=self.name, upgrade=upgrade)

    def _wrong_clock(self, clock: tuple[Mapping[str, str], ...]) -> Iterator[str]:
        """Yield a warning if the clock is outside the certificate's validity; a rehearsal's clock is not checked."""
        today = next((row.get("date", "") for row in clock), "")
        first, last = (f"{day:%Y-%m-%d}" for day in (self.identity.certificate.not_before, self._expiry))
        if _DATE.fullmatch(today) and not self.is_rehearsal and not first <= today <= last:
            yield msg(
                f"its clock says {arg(today)}: the tunnel cannot come up until the clock is right, see `/system ntp "
                "client print`"
            )

    @property
    def _expiry(self) -> datetime:
        return self.identity.certificate.not_after

    def _left_by_us(self, row: Mapping[str, str]) -> bool:
        """Return True for an imported interface never renamed: with our server and user it has no other use."""
        ours = (row.get("connect-to"), row.get("user")) == (self.tunnel.connect_to, self.tunnel.user)
        return ours and row.get("name", "").startswith(_IMPORT_PREFIX)

    def _is_marked(self, row: Mapping[str, str]) -> bool:
        return row.get("mac-address", "").upper() == self.mark

    def _changes(
        self,
        interface: Mapping[str, str] | None,
        certificate: Mapping[str, str] | None,
        stale: tuple[str, ...],
        files: tuple[str, ...],
    ) -> Iterator[str]:
        yield from (msg(f"file {arg(name)} of an earlier run removed") for name in files)
        yield from ("interface of an earlier run removed" for _ in stale)
        certificate_name, until = self.tunnel.certificate, f"{self._expiry:%Y-%m-%d}"
        if certificate is None:
            yield msg(f"certificate {arg(certificate_name)} imported, valid until {arg(until)}")
        elif certificate.get("name") != certificate_name:
            yield msg(f"certificate {arg(certificate.get('name'))} renamed to {arg(certificate_name)}")
        if interface is None:
            yield msg(f"interface {arg(self.tunnel.name)} imported")
        elif not self._is_marked(interface):
            yield msg(f"interface {arg(self.tunnel.name)} imported, replacing the existing one")
        else:
            other = sorted(name for name, value in self.tunnel.values().items() if _plain(interface, name) != value)
            if other:
                yield msg(f"interface {arg(self.tunnel.name)}: {arg(join(', ', other))}")

    def _is_session_over_tunnel(
        self, routes: tuple[Mapping[str, str], ...], active: tuple[Mapping[str, str], ...]
    ) -> bool:
        networks = [_network(row.get("dst-address", "")) for row in routes]
        ours = [row for row in active if row.get("name") == self.endpoint.user and "api" in row.get("via", "")]
        peers = [_network(row.get("address", "")) for row in ours]
        return any(peer.subnet_of(network) for peer in peers if peer for network in networks if network)

    # --- doing -----------------------------------------------------------------------------------------------------

    async def _import(self, session: api.Session, observation: RouterObservation) -> None:
        for name in observation.files:
            await _do(session, "/file/remove", numbers=name)
        for number in observation.stale:
            await _do(session, f"{_MENU}/remove", **{".id": number})
        certificate = observation.certificate
        if certificate is None:
            certificate = await self._import_certificate(session, observation)
        if observation.interface is not None and self._is_marked(observation.interface):
            number = observation.interface[".id"]
        else:
            number = await self._import_interface(session)
            if observation.interface is not None:
                await _do(session, f"{_MENU}/remove", **{".id": observation.interface[".id"]})
        properties = {**self.tunnel.values(), "certificate": certificate["name"], "mac-address": self.mark}
        await _do(session, f"{_MENU}/set", **{".id": number}, **properties, password=self.tunnel.password.reveal())
        await self._name(session, observation, certificate)

    async def _import_certificate(self, session: api.Session, observation: RouterObservation) -> Mapping[str, str]:
        self._say(events.Stage.APPLYING, msg(f"certificate {arg(self.tunnel.certificate)}"))
        authority = "" if observation.authority else self.identity.ca
        text = f"{self.identity.cert}{self.identity.key.reveal()}{authority}"
        async with self._file(session, PEM, text):
            name = f"{self.tunnel.certificate}-new"
            await _do(session, f"{_CERTIFICATES}/import", **{"file-name": PEM, "passphrase": "", "name": name})
        result = (await self._look(session)).certificate
        if result is None:
            raise DeviceError(f"{arg(self.name)} does not list the imported certificate")
        return result

    async def _import_interface(self, session: api.Session) -> str:
        self._say(events.Stage.APPLYING, f"interface {self.tunnel.name}")
        async with self._file(session, PROFILE, self.profile.reveal()):
            arguments = {
                "file-name": PROFILE,
                "ovpn-user": self.tunnel.user,
                "ovpn-password": self.tunnel.password.reveal(),
                "skip-cert-import": "yes",
            }
            await _do(session, f"{_MENU}/import-ovpn-configuration", **arguments)
            for _ in range(_TRIES):
                stale = (await self._look(session)).stale
                if stale:
                    return stale[-1]
                await asyncio.sleep(_PAUSE_S)
        raise DeviceError(
            f"{arg(self.name)} imported the configuration but shows no interface for it",
            hint='on the router: `/log print where topics~"ovpn"`',
        )

    async def _name(self, session: api.Session, observation: RouterObservation, certificate: Mapping[str, str]) -> None:
        """Give the certificate its final name; the previous one is removed, with its key."""
        if certificate["name"] == self.tunnel.certificate:
            return
        if observation.conflict is not None:
            old = observation.conflict[".id"]
            await _do(session, f"{_CERTIFICATES}/set", **{".id": old, "name": f"{self.tunnel.certificate}-old"})
            await _do(session, f"{_CERTIFICATES}/remove", **{".id": old})
        arguments = {".id": certificate[".id"], "name": self.tunnel.certificate}
        await _do(session, f"{_CERTIFICATES}/set", **arguments)

    @asynccontextmanager
    async def _file(self, session: api.Session, name: str, text: str) -> AsyncIterator[None]:
        """Keep a file on the router inside the block; if the session is lost, a new session removes it."""
        try:
            await _do(session, "/file/add", name=name, contents=text)
            yield
        finally:
            await self._remove_file(session, name)

    async def _remove_file(self, session: api.Session, name: str) -> None:
        try:
            await session.command(api.Command("/file/remove", (("numbers", name),)))
        except api.SessionLost:
            try:
                async with await api.Session.open(self.endpoint) as again:
                    await again.command(api.Command("/file/remove", (("numbers", name),)))
            except DeviceError:
                return  # the loss itself is what is told; the next run finds the file

    def _say(self, stage: events.Stage, message: str) -> None:
        self.notify(events.Event(self.name, stage, message))


_REPLACEMENT_NOTE = (
    "rows that named the former interface (lists, routes) no longer do: type `provision site={site}` when this is done"
)


def _plain(row: Mapping[str, str], name: str) -> str:
    value = row.get(name, "")
    return _SAME.get(value, value)


def _ca_fingerprint(identity: Identity) -> str:
    from atlantis_netcfg.vpn import pki  # noqa: PLC0415 - for one fingerprint

    return pki.sha256(pki.load_cert(identity.ca))


async def _do(session: api.Session, path: str, **arguments: str) -> None:
    """Run one command. Raises DeviceError with the router's message."""
    try:
        (await session.command(api.Command(path, tuple(arguments.items())))).check()
    except api.CommandError as refused:
        raise DeviceError(
            str(refused), hint="no key file is left on it; run the same command again when the cause is fixed"
        ) from refused


def _network(text: str) -> IPv4Network | None:
    """Parse an address or network as printed by a device; None for anything else."""
    try:
        return IPv4Network(text, strict=False)
    except ValueError:
        return None
