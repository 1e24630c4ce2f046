"""The vehicle is a station of an access point of the site: whoever runs that access point says how it hears it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.bearers.wifi import Family
from atlantis_netcfg.bearers.wifi import queries as wifi_queries
from atlantis_netcfg.bearers.wifi import read as read_wifi
from atlantis_netcfg.checklist.probes import _path, _ping
from atlantis_netcfg.checklist.probes.evidence import declared, read
from atlantis_netcfg.checklist.probes.not_run import rows_of, unasked
from atlantis_netcfg.checklist.probes.requests import Ask
from atlantis_netcfg.checklist.probes.results import Rows
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.checklist.probes.wifi._associated import FAIL_LOSS_PERCENT
from atlantis_netcfg.checklist.probes.wifi._level import judge_chains, judge_level, judge_rate
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.bearers.wifi import WifiPeer
    from atlantis_netcfg.checklist.probes.requests import Place, Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.report import Evidence
    from atlantis_netcfg.declaration.model import WifiEndpoint

__all__ = ["RegisteredProbe"]


@dataclass(frozen=True, slots=True)
class RegisteredProbe:
    """The vehicle is registered at the site's access point, is heard well, and answers.

    Asked of the RouterOS device `seen_by`: the registration tables of both generations; on the gateway (or the laptop):
    `ip -j route get ADDRESS` and `ping -n -c 20 -i 0.2 -W 2 ADDRESS`. Without `seen_by` only these.
    """

    name: str
    place: Place
    endpoint: WifiEndpoint
    address: str | None
    mac: str | None
    """Of the vehicle's radio, upper case; None: nobody has declared it."""

    def asks(self) -> tuple[Question, ...]:
        """Give the tables and the ping."""
        host = self.endpoint.seen_by
        tables = () if host is None else tuple(Ask(f, host, wifi_queries(f, "")[0]) for f in Family)
        if self.address is None:
            return tables
        return (*tables, _path.ask_way(self.place, self.address), _ping.ask(self.place, self.address))

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge what the access point says, then the ping; where nobody can ask the access point, the ping is first."""
        parts = [self._told(results), self._reached(results)]
        if self.endpoint.seen_by is None:
            parts.reverse()
        findings = tuple(finding for part in parts for finding in part.findings)
        return Judged(findings, tuple(evidence for part in parts for evidence in part.evidence))

    def _told(self, results: Mapping[str, Answer]) -> Judged:
        host = self.endpoint.seen_by
        if host is None:
            message = f"no device of ours sees the association of {self.name}, nor its signal"
            hint = "its ping is all there is: name the access point's RouterOS device in `endpoints.wifi.seen_by`"
            return Judged((Finding(Verdict.WARN, "association-unseen", message, hint),))
        answers = {family: results.get(family) for family in Family}
        if all(not isinstance(result, Rows) or result.trouble is not None for result in answers.values()):
            return Judged((unasked(host, answers[Family.WIRELESS]),))
        tables = {family: rows for family, answer in answers.items() if (rows := rows_of(answer)) is not None}
        if not tables:
            message = f"{host} has no registration table, in neither of its two menus for radios"
            hint = "is `endpoints.wifi.seen_by` the device with the access point? RouterOS 7.13 on needs a package"
            return Judged((Finding(Verdict.INCONCLUSIVE, "no-radio", message, hint),))
        peers = [peer for family, rows in tables.items() for peer in read_wifi(family, rows, None).peers]
        return self._registered(host, peers)

    def _registered(self, host: str, peers: list[WifiPeer]) -> Judged:
        others = f"{len(peers)} other{'' if len(peers) == 1 else 's'}" if peers else "nobody else"
        if self.mac is None:
            message = f"nobody has declared the MAC address of {self.name}, by which {host} would know it"
            hint = "write `endpoints.wifi.mac`, or reserve its address in `site.lan.reservations`"
            return Judged((Finding(Verdict.INCONCLUSIVE, "mac-unknown", message, hint),))
        mine = next((peer for peer in peers if peer.mac == self.mac), None)
        if mine is None:
            message = f"{self.name} ({self.mac}) is not registered at {host}; {others} is"
            hint = "is it on, with the SSID and key of the site? If its radio was exchanged, correct its MAC address"
            return Judged((Finding(Verdict.FAIL, "not-registered", message.replace("others is", "others are"), hint),))
        return Judged(tuple(self._findings(host, mine)), self._evidence(host, mine))

    def _findings(self, host: str, peer: WifiPeer) -> Iterator[Finding]:
        if peer.authorised is False:
            message = f"{self.name} is registered at {host}, but not authorised: the keys differ"
            yield Finding(Verdict.FAIL, "not-authorised", message, "compare the key of the vehicle with the site's")
        else:
            level = "" if peer.signal_dbm is None else f", heard with {peer.signal_dbm:g} dBm"
            yield Finding(Verdict.PASS, "registered", f"{self.name} is registered at {host}{level}")
        yield from judge_level(self.endpoint, peer.signal_dbm, self.name, host)
        yield from judge_chains(peer.chains_dbm, self.name, host)
        yield from judge_rate(self.endpoint, peer.tx_rate_mbps, peer.rx_rate_mbps, self.name, host)

    def _evidence(self, host: str, peer: WifiPeer) -> tuple[Evidence, ...]:
        chains = ", ".join("?" if item is None else f"{item:g}" for item in peer.chains_dbm)
        shown = (
            ("station registered at", peer.mac, ""),
            ("signal at", peer.signal_dbm, "dBm"),
            ("chains of", chains or None, "dBm"),
            ("signal to noise at", peer.snr_db, "dB"),
            ("rate sent at by", peer.tx_rate_mbps, "Mbit/s"),
            ("rate received at by", peer.rx_rate_mbps, "Mbit/s"),
            ("registered for, at", peer.uptime_s, "s"),
        )
        result = tuple(read(f"{what} {host}", value, unit) for what, value, unit in shown if value is not None)
        bounds = f"{self.endpoint.low_dbm:g} to {self.endpoint.high_dbm:g} dBm"
        return (*result, declared("signal wanted", bounds))

    def _reached(self, results: Mapping[str, Answer]) -> Judged:
        if self.address is None:
            message = f"no address of {self.name} is known here: loss and round trip were not measured"
            hint = "reserve one in `site.lan.reservations`, or write `endpoints.wifi.address`"
            return Judged((Finding(Verdict.WARN, "no-address", message, hint),))
        way = _path.read_way(results.get("route"), self.address)
        if local := tuple(_path.own_address(self.place, self.name, self.address, way)):
            return Judged(local)
        expected = _ping.Pinged(self.name, self.address, self.place, self.endpoint.loss_percent, FAIL_LOSS_PERCENT)
        return _ping.judge(expected, results.get("ping"))
