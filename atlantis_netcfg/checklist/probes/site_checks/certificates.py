"""Check that the site's certificates are valid, and will be for some weeks."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.checklist.probes.site_checks.clock import router_time
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.routeros.render import prerequisites

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


IDENTITY = "/etc/openvpn/client/atlantis.identity"
"""Certificates and keys of a gateway computer in the VPN; a test keeps it the same as in `vpn.client`."""
SOON = timedelta(days=30)
_MENU = ("name", "common-name", "invalid-before", "invalid-after", "expired", "revoked", "private-key", "authority")
_SUBJECT = re.compile(r"^ {8}Subject:.*?CN ?= ?([^,\n]+)", re.MULTILINE)
_DATES = re.compile(r"Not Before *: (.+?)\n\s*Not After *: (.+?)\n")
_API = "create another one on the router under the same name (docs/routers.md), and confirm it at the next contact"
_ROUTER = (
    "`provision vpn renew name={name}` creates a new one, and `provision vpn install device={name}` installs "
    "it on the router"
)
_COMPUTER = (
    "`provision vpn renew name={name}` creates a new one, `provision vpn accept file=FILE` accepts it on "
    "another laptop, and `provision site={site} device={name}` installs it"
)
_STAMP = "%b %d %H:%M:%S %Y GMT"


@dataclass(frozen=True, slots=True)
class _SiteCertificate:
    holder: str
    """Device that holds it."""
    name: str
    since: datetime | None
    until: datetime | None
    used: bool = True
    """Whether the inventory says what it is for; an authority is always used."""
    is_expired: bool = False
    """Whether the device itself reports it as expired."""
    unfit: str = ""
    """Why it is unusable, however long it is valid."""
    renew: str = ""
    """How to replace it."""

    @property
    def title(self) -> str:
        return msg(f"certificate `{arg(self.name)}` of {arg(self.holder)}")


def certificates_check(site: parse.OwnSite) -> base.Step:
    """Return the step on certificates of the router and the gateway computer's identity; keys are not read."""
    return parse.step("certificates", "Certificates are valid", _Certificates(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _Certificates:
    """Check that certificates are valid."""

    site: parse.OwnSite

    @property
    def _is_gateway_in_vpn(self) -> bool:
        return self.site.gateway is not None and self.site.gateway.device.vpn_address is not None

    def asks(self) -> tuple[base.Question, ...]:
        local = parse.run("identity", self.site, f"openssl storeutl -noout -text -certs {IDENTITY}")
        return (*parse.ask("router", self.site, "/certificate", *_MENU), *(local if self._is_gateway_in_vpn else ()))

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        result = parse.rows(results["router"], self.site.router.name, "its certificates", "name")
        missing: list[LinkFinding] = []
        certificates: list[_SiteCertificate] = []
        if isinstance(result, LinkFinding):
            missing.append(result)
        else:
            missing += self._missing_certificates(result)
            certificates += self._router_certificates(result)
        if self._is_gateway_in_vpn:
            assert self.site.gateway is not None  # noqa: S101 - just looked
            local = _of_identity(self.site.gateway.name, self.site.name, results["identity"])
            missing += [local] if isinstance(local, LinkFinding) else []
            certificates += [] if isinstance(local, LinkFinding) else local
        now = _now(results)
        wrong = [finding for item in certificates for finding in _judge_certificate(item, now)]
        evidence = tuple(
            parse.read(msg(f"{arg(certificate.title)}: valid until"), f"{certificate.until:%Y-%m-%d}")
            for certificate in certificates
            if certificate.until
        )
        return base.ProbeResult((*wrong, *missing) or (_fine(certificates),), evidence)

    @property
    def _reason_by_name(self) -> Mapping[str, str]:
        """Purpose of each certificate that the inventory requires, by name."""
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        all_of_it = prerequisites(self.site.inventory, self.site.router)
        return {
            prerequisite.name: prerequisite.reason for prerequisite in all_of_it if prerequisite.menu == "/certificate"
        }

    def _missing_certificates(self, result: Sequence[Mapping[str, str]]) -> Iterator[LinkFinding]:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        there = {row.get("name") for row in result}
        for name, reason in self._reason_by_name.items():
            if name not in there:
                message = msg(f"{arg(self.site.router.name)} has no certificate `{arg(name)}`: {arg(reason)}")
                yield parse.fail("certificate-missing", message, self._renewal(name))

    def _renewal(self, name: str) -> str:
        """Return how to renew: the VPN issues the tunnel's certificates, the router itself that of api-ssl."""
        tunnel = self.site.view.tunnel if self.site.view is not None else None
        of_the_vpn = name not in self._reason_by_name or (tunnel is not None and name == tunnel.certificate)
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        return msg(_ROUTER.format(name=arg(self.site.router.name))) if of_the_vpn else _API

    def _router_certificates(self, result: Sequence[Mapping[str, str]]) -> Iterator[_SiteCertificate]:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        for row in result:
            since, until = (_router_stamp(row.get(name, "")) for name in ("invalid-before", "invalid-after"))
            name = row.get("name", "?")
            used = name in self._reason_by_name or parse.yes(row, "authority")
            if until is not None or name in self._reason_by_name:
                renew, is_expired, unfit = self._renewal(name), parse.yes(row, "expired"), self._unfit(name, row)
                host = self.site.router.name
                yield _SiteCertificate(
                    host, name, since, until, used=used, is_expired=is_expired, unfit=unfit, renew=renew
                )

    def _unfit(self, name: str, row: Mapping[str, str]) -> str:
        """Return why the router cannot use a certificate, even if it is valid; empty if no reason is known."""
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        tunnel = self.site.view.tunnel if self.site.view is not None else None
        host, subject = self.site.router.name, row.get("common-name")
        if parse.yes(row, "revoked"):
            return "is revoked"
        if name in self._reason_by_name and row.get("private-key") in {"false", "no"}:
            return "has no private key there, so it cannot be used"
        if tunnel is not None and name == tunnel.certificate and subject not in {None, host}:
            return msg(f"belongs to {arg(subject)}, not to {arg(host)}")
        return ""


def _now(results: Mapping[str, base.Answer]) -> datetime:
    """Return when this computer received the latest response."""
    stamps = [answer.response_time for answer in results.values() if isinstance(answer, base.CommandResult | base.Rows)]
    return datetime.fromtimestamp(max(stamps, default=0.0) or time.time(), UTC)


def _router_stamp(text: str) -> datetime | None:
    date, _, clock = text.partition(" ")
    return router_time({"date": date, "time": clock})


def _of_identity(name: str, site: str, answer: base.Answer) -> list[_SiteCertificate] | LinkFinding:
    """Parse openssl's output on all certificates in a file; it exits with 8 for a key that it does not know."""
    if not isinstance(answer, base.CommandResult):
        return parse.unreadable(name, "its VPN identity")
    if answer.trouble is not None:
        return parse.silent(name, answer.trouble, answer.words)
    names, dates = _SUBJECT.findall(answer.out), _DATES.findall(answer.out)
    if not dates or len(names) != len(dates):
        hint = msg(f"`provision site={arg(site)} device={arg(name)}` installs it; only root may read it")
        return parse.unknown(
            "identity-unreadable", msg(f"no certificate can be read from the VPN identity of {arg(name)}"), hint
        )
    renew = msg(_COMPUTER.format(name=arg(name), site=arg(site)))
    if name not in [subject.strip() for subject in names]:
        there = parse.join_words(subject.strip() for subject in names)
        return parse.fail(
            "other-identity",
            msg(f"the VPN identity of {arg(name)} contains {arg(there)}, but no certificate of {arg(name)}"),
            renew,
        )
    return [
        _SiteCertificate(name, subject.strip(), _stamp(since), _stamp(until), renew=renew)
        for subject, (since, until) in zip(names, dates, strict=True)
    ]


def _stamp(text: str) -> datetime | None:
    try:
        return datetime.strptime(text, _STAMP).replace(tzinfo=UTC)
    except ValueError:
        return None


def _judge_certificate(certificate: _SiteCertificate, now: datetime) -> Iterator[LinkFinding]:
    if certificate.until is None:
        yield parse.unknown(
            "no-date",
            msg(f"the expiry date of the {arg(certificate.title)} is unknown"),
            msg(f"check {arg(certificate.holder)} manually"),
        )
    elif not certificate.used:
        if certificate.until < now or certificate.is_expired:
            text = msg(f"the {arg(certificate.title)} expired on {arg(certificate.until):%Y-%m-%d}")
            message = msg(f"{arg(text)}, and nothing in the inventory uses it")
            yield parse.warn("old-certificate", message, msg(f"remove it from {arg(certificate.holder)}"))
    elif certificate.unfit:
        yield parse.fail("unfit", msg(f"the {arg(certificate.title)} {arg(certificate.unfit)}"), certificate.renew)
    elif certificate.until < now:
        yield parse.fail(
            "expired",
            msg(f"the {arg(certificate.title)} expired on {arg(certificate.until):%Y-%m-%d}"),
            certificate.renew,
        )
    elif certificate.is_expired:
        message = msg(
            f"{arg(certificate.holder)} treats its certificate `{arg(certificate.name)}` as expired, although it is "
            "valid until"
        )
        yield parse.fail(
            "clock-expired",
            f"{message} {certificate.until:%Y-%m-%d}",
            msg(f"set the clock of {arg(certificate.holder)} first"),
        )
    elif certificate.since is not None and certificate.since > now + timedelta(minutes=5):
        message = msg(f"the {arg(certificate.title)} is not valid before {arg(certificate.since):%Y-%m-%d %H:%M} UTC")
        yield parse.fail(
            "not-yet-valid", message, "check the clocks of this computer and of the device: one of them is wrong"
        )
    elif certificate.until < now + SOON:
        days = (certificate.until - now).days
        yield parse.warn(
            "expires-soon",
            msg(f"the {arg(certificate.title)} expires in {arg(days)} days, on {arg(certificate.until):%Y-%m-%d}"),
            certificate.renew,
        )


def _fine(certificates: Sequence[_SiteCertificate]) -> LinkFinding:
    """Return the passing finding on the certificates in use; missing ones have their own finding."""
    until = [certificate.until for certificate in certificates if certificate.used and certificate.until is not None]
    if len(until) == 1:
        return parse.good("valid", msg(f"the only certificate is valid until {arg(until[0]):%Y-%m-%d}"))
    return parse.good(
        "valid", msg(f"{arg(len(until))} certificates are valid; the first expires on {arg(min(until)):%Y-%m-%d}")
    )
