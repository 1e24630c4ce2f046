"""The vehicle is the access point, and the computer's radio is to be associated with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes import _path, _ping
from atlantis_netcfg.checklist.probes.evidence import declared, read
from atlantis_netcfg.checklist.probes.not_run import PLACES, not_run
from atlantis_netcfg.checklist.probes.requests import Run
from atlantis_netcfg.checklist.probes.results import Ran
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.checklist.probes.wifi import _channel, _iw
from atlantis_netcfg.checklist.probes.wifi._level import judge_chains, judge_level, judge_rate
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.requests import Place, Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.report import Evidence
    from atlantis_netcfg.declaration.model import WifiEndpoint

__all__ = ["FAIL_LOSS_PERCENT", "AssociatedProbe"]

FAIL_LOSS_PERCENT = 50.0
"""From here a Wi-Fi does not serve: our own judgement. In between it warns."""


@dataclass(frozen=True, slots=True)
class AssociatedProbe:
    """The computer's radio is associated with the vehicle's access point, hears it well, and reaches the vehicle.

    Asked on the gateway (or the laptop): `iw dev IF link`, `iw dev IF station dump`, `iw dev IF info`, `iw reg get`,
    `ip -j addr show dev IF`, and with an address `ip -j route get ADDRESS`, `ping -n -c 20 -i 0.2 -W 2 ADDRESS`.
    """

    name: str
    """Of the vehicle, in words."""
    place: Place
    endpoint: WifiEndpoint
    address: str | None
    country: str
    """Of the pilot, in RouterOS' word."""

    def asks(self) -> tuple[Question, ...]:
        """Give the radio's view, the interface and the way to the vehicle."""
        radio = self.endpoint.interface
        requested = (
            Run("link", self.place, ("iw", "dev", radio, "link")),
            Run("stations", self.place, ("iw", "dev", radio, "station", "dump")),
            Run("info", self.place, ("iw", "dev", radio, "info")),
            Run("rules", self.place, ("iw", "reg", "get")),
            _path.ask_card(self.place, radio),
        )
        if self.address is None:
            return requested
        return (*requested, _path.ask_way(self.place, self.address), _ping.ask(self.place, self.address))

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Association first: without it nothing else speaks of this vehicle."""
        addr = results.get("addr")
        absent = (*not_run(self.place, "ip", addr), *self._no_interface(addr), *self._no_iw(results.get("link")))
        if absent:
            return Judged(absent[:1])
        link = self._link(results)
        if link is None:
            text = _out(results, "link").strip() or _err(results, "link").strip() or "nothing"
            message = f"`iw` says of {self._radio} what nobody understands: {text.splitlines()[0][:100]}"
            hint = f"type it by hand there: iw dev {self.endpoint.interface} link"
            return Judged((Finding(Verdict.INCONCLUSIVE, "association-unknown", message, hint),))
        if apart := self._apart(link, results):
            return Judged((apart,), self._evidence(link, None))
        station = _iw.read_station(_out(results, "stations"), link.bssid or "")
        reached = self._reached(results)
        found = (*self._identity(link, station), *self._radio_says(link, station, results), *reached.findings)
        return Judged(found, (*self._evidence(link, station), *reached.evidence))

    @property
    def _radio(self) -> str:
        return f"{self.endpoint.interface} of {PLACES[self.place]}"

    def _no_interface(self, addr: Answer | None) -> Iterator[Finding]:
        """Say that the radio is not there, or is switched off."""
        card = _path.read_card(addr)
        if isinstance(addr, Ran) and card is None and "does not exist" in addr.err:
            hint = "plug the radio in, or correct `endpoints.wifi.interface`: `ip -br link` lists what there is"
            message = f"{PLACES[self.place]} has no interface {self.endpoint.interface}"
            yield Finding(Verdict.FAIL, "no-interface", message, hint)
        elif card is not None and not card.up:
            hint = f"on it: rfkill list; sudo ip link set {self.endpoint.interface} up"
            yield Finding(Verdict.FAIL, "interface-off", f"{self._radio} is switched off", hint)

    def _no_iw(self, link: Answer | None) -> Iterator[Finding]:
        """Say that the radio cannot be asked."""
        yield from not_run(self.place, "iw", link)
        if isinstance(link, Ran) and link.rc and "No such device" in link.err:
            hint = "correct `endpoints.wifi.interface`: `iw dev` lists the radios that there are"
            message = f"{self.endpoint.interface} of {PLACES[self.place]} is not a radio"
            yield Finding(Verdict.FAIL, "no-radio", message, hint)
        elif isinstance(link, Ran) and "nl80211 not found" in link.err:
            hint = "plug a radio in, or load the driver of the one that it has"
            message = f"{PLACES[self.place]} has no radio that its kernel knows"
            yield Finding(Verdict.FAIL, "no-radio", message, hint)

    def _link(self, results: Mapping[str, Answer]) -> _iw.Link | None:
        return _iw.read_link(_out(results, "link"))

    def _apart(self, link: _iw.Link, results: Mapping[str, Answer]) -> Finding | None:
        """Say that the radio is not associated with the vehicle; None: it is, as far as can be told."""
        kind = _iw.read_type(_out(results, "info"))
        if link.bssid is None and kind is not None and kind != "managed":
            message = f"{self._radio} is no client of an access point, but of type {kind}"
            hint = f"the vehicle is the access point here: what has set {self.endpoint.interface} up so?"
            return Finding(Verdict.FAIL, "no-client", message, hint)
        if link.bssid is None:
            hint = f"is {self.name} on and its antenna out of the water? Then compare SSID and key at both ends"
            message = f"{self._radio} is not associated with {self._expected}"
            return Finding(Verdict.FAIL, "not-associated", message, hint)
        ssid = self.endpoint.ssid
        if ssid is not None and link.ssid is not None and link.ssid != ssid:
            message = (
                f"{self._radio} is associated with `{link.ssid}`, and a radio hears one access point at a time:"
                f" `{ssid}` cannot be judged"
            )
            hint = f"connect it to `{ssid}` when the other vehicle is done, or give each vehicle a radio of its own"
            return Finding(Verdict.INCONCLUSIVE, "other-association", message, hint)
        if self.endpoint.mac is not None and link.bssid != str(self.endpoint.mac).upper():
            message = f"{link.bssid} sends as {self._expected}, and the radio of {self.name} is {self.endpoint.mac}"
            hint = "correct `endpoints.wifi.mac` if its radio was exchanged; else find out who sends under this name"
            return Finding(Verdict.FAIL, "other-radio", message, hint)
        return None

    @property
    def _expected(self) -> str:
        return f"`{self.endpoint.ssid}` of {self.name}" if self.endpoint.ssid else f"the access point of {self.name}"

    def _identity(self, link: _iw.Link, station: _iw.Station | None) -> Iterator[Finding]:
        dbm = _level(link, station)
        level = "" if dbm is None else f", heard with {dbm:g} dBm"
        who = f"`{link.ssid}`" if link.ssid else str(link.bssid)
        yield Finding(Verdict.PASS, "associated", f"{self._radio} is associated with {who} of {self.name}{level}")
        if (self.endpoint.ssid is None or link.ssid is None) and self.endpoint.mac is None:
            message = f"nothing tells whether {who} is the access point of {self.name}"
            yield Finding(Verdict.WARN, "whose-unknown", message, "declare its `ssid`, or the `mac` of its radio")

    def _radio_says(
        self, link: _iw.Link, station: _iw.Station | None, results: Mapping[str, Answer]
    ) -> Iterator[Finding]:
        yield from judge_level(self.endpoint, _level(link, station), self.name, self._radio)
        yield from judge_chains(station.chains_dbm if station else (), self.name, self._radio)
        sent, received = _rates(link, station)
        yield from judge_rate(self.endpoint, sent, received, self.name, self._radio)
        width = _iw.read_width(_out(results, "info"))
        yield from _channel.judge_channel(self.country, link.frequency_mhz, width, self.name)
        rules = _iw.read_rules(_out(results, "rules"))
        yield from _channel.judge_country(self.country, rules, PLACES[self.place])

    def _reached(self, results: Mapping[str, Answer]) -> Judged:
        """Ping it; what goes another way than by this radio says nothing of it."""
        if self.address is None:
            message = f"no address of {self.name} is known here: loss and round trip were not measured"
            hint = "reserve one in `site.lan.reservations`, or write `endpoints.wifi.address`"
            return Judged((Finding(Verdict.WARN, "no-address", message, hint),))
        way = _path.read_way(results.get("route"), self.address)
        card = _path.read_card(results.get("addr"))
        mine = {self.endpoint.interface, card.master if card else None}
        if way is not None and way.interface not in mine:
            message = f"packets to {self.name} ({self.address}) leave by {way.interface}, and not by {self._radio}"
            hint = f"type it there: ip route get {self.address}; then correct the address or the route"
            return Judged((Finding(Verdict.FAIL, "other-way", message, hint),), (read("way", way.interface),))
        if way is None and not tuple(not_run(self.place, "ip", results.get("route"))):
            message = f"{PLACES[self.place]} has no route to {self.name} ({self.address})"
            hint = f"does {self.endpoint.interface} have an address? On it: ip -br addr"
            return Judged((Finding(Verdict.FAIL, "no-route", message, hint),))
        expected = _ping.Pinged(self.name, self.address, self.place, self.endpoint.loss_percent, FAIL_LOSS_PERCENT)
        return _ping.judge(expected, results.get("ping"))

    def _evidence(self, link: _iw.Link, station: _iw.Station | None) -> tuple[Evidence, ...]:
        at = self._radio
        sent, received = _rates(link, station)
        shown = (
            ("access point heard by", f"{link.ssid or '?'} ({link.bssid})" if link.bssid else "none", ""),
            ("channel of", link.frequency_mhz, "MHz"),
            ("signal at", _level(link, station), "dBm"),
            ("chains of", ", ".join(f"{item:g}" for item in station.chains_dbm) if station else None, "dBm"),
            ("rate sent at by", sent, "Mbit/s"),
            ("rate received at by", received, "Mbit/s"),
        )
        result = tuple(read(f"{what} {at}", value, unit) for what, value, unit in shown if value not in {None, ""})
        bounds = f"{self.endpoint.low_dbm:g} to {self.endpoint.high_dbm:g} dBm"
        return (*result, declared("signal wanted", bounds))


def _level(link: _iw.Link, station: _iw.Station | None) -> float | None:
    mean = None if station is None else station.signal_dbm
    return link.signal_dbm if mean is None else mean


def _rates(link: _iw.Link, station: _iw.Station | None) -> tuple[float | None, float | None]:
    return (
        link.tx_mbps if link.tx_mbps is not None or station is None else station.tx_mbps,
        link.rx_mbps if link.rx_mbps is not None or station is None else station.rx_mbps,
    )


def _out(results: Mapping[str, Answer], name: str) -> str:
    ran = results.get(name)
    return ran.out if isinstance(ran, Ran) and ran.trouble is None else ""


def _err(results: Mapping[str, Answer], name: str) -> str:
    ran = results.get(name)
    return ran.err if isinstance(ran, Ran) else ""
