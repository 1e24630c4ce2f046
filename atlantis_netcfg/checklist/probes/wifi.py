"""Wi-Fi: the vehicle's own, as access point or as station, and the site's bridge.

An AUV carries an access point that is usable on the surface only (report 2.2.2), and the gateway's radio is its client:
`iw` on the gateway reports the association, the level and the rate. ASV and UAV are stations of the site: its access
point reports them, if it is a RouterOS device. Loss and round trip are measured between hosts in either case; the
bridge of a location is judged as in `provision links`.

Limits of levels: devices.md, section 8. A receiver saturates at short distance, so there is an upper limit too (a
report of two radios has -27 dBm and 34 % quality at full power, -47 dBm and 94 % reduced). From 10 dB beyond a limit, a
tenth or ten times the power, it no longer passes: our own judgement.

Also: parsing `iw` output about stations, and checking whether its channel and country are allowed.

`iw` prints text for people only (iw(8): "do not screenscrape"), but nothing else on a gateway reports the level.
Formats read: iw 4.14 to 6.7 (`link.c`, `station.c`, `interface.c`, `reg.c`); a line that cannot be parsed is skipped,
and missing values are None.

The report agreed on 802.11a and 802.11g, which are 5 GHz and 2.4 GHz (2.4.1 swaps them). `site.channels` has the
channels allowed outdoors, from the decisions that hold in both countries of the pilot.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base, ping
from atlantis_netcfg.checklist.probes.link_probe import link_steps, reserved_mac
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import channels, model
from atlantis_netcfg.links import LinkFinding, wifi

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


_CONNECTION = re.compile(r"^Connected to ((?:[0-9a-f]{2}:){5}[0-9a-f]{2})\b", re.IGNORECASE | re.MULTILINE)
_FIELD = re.compile(r"^\s*([A-Za-z][A-Za-z ]*?):[ \t]*(.*?)[ \t]*$", re.MULTILINE)
_STATION = re.compile(r"^Station ((?:[0-9a-f]{2}:){5}[0-9a-f]{2})\b.*$", re.IGNORECASE | re.MULTILINE)
_LEVEL = re.compile(r"(-\d+)(?: \[([-\d, ]+)\])? dBm")
_RATE = re.compile(r"(\d+(?:\.\d+)?) MBit/s")
_MHZ = re.compile(r"(\d{4})(?:\.\d+)?")
_ESCAPE = re.compile(r"\\x([0-9a-fA-F]{2})")
_TYPE = re.compile(r"^\s*type (\S+)", re.MULTILINE)
_SSID = re.compile(r"^\s*ssid (.+)$", re.MULTILINE)
_CHANNEL = re.compile(r"^\s*channel \d+ \((\d+) MHz\)", re.MULTILINE)
_WIDTH = re.compile(r"width: (\d+) MHz")
_COUNTRY = re.compile(r"^country ([A-Z0-9]{2}):", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class WifiLink:
    """Output of `iw dev INTERFACE link`."""

    bssid: str | None = None
    """Upper case; None: not associated."""
    ssid: str | None = None
    frequency_mhz: int | None = None
    signal_dbm: float | None = None
    rx_mbps: float | None = None
    tx_mbps: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """A station in `iw dev INTERFACE station dump`; for a client, its access point."""

    signal_dbm: float | None = None
    """Mean of the latest frames if the driver keeps one."""
    chains_dbm: tuple[float, ...] = ()
    rx_mbps: float | None = None
    tx_mbps: float | None = None


@dataclass(frozen=True, slots=True)
class OpenedRadio:
    """Output of `iw dev INTERFACE info` for an access point; None: not reported."""

    type: str | None
    ssid: str | None
    frequency_mhz: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """Output of `iw reg get`: countries of the rules in force, the system's first; `00` is the world's."""

    countries: tuple[str, ...] = ()


def read_link(out: str) -> WifiLink | None:
    """Parse an association; None if the output cannot be parsed."""
    if out.strip().startswith("Not connected"):
        return WifiLink()
    match = _CONNECTION.search(out)
    if match is None:
        return None
    fields = dict(_fields(out))
    mhz = _MHZ.match(fields.get("freq", ""))
    return WifiLink(
        bssid=match[1].upper(),
        ssid=_plain(fields["SSID"]) if "SSID" in fields else None,
        frequency_mhz=int(mhz[1]) if mhz else None,
        signal_dbm=_levels(fields.get("signal", ""))[0],
        rx_mbps=_rate(fields.get("rx bitrate", "")),
        tx_mbps=_rate(fields.get("tx bitrate", "")),
    )


def read_station(out: str, bssid: str) -> Station | None:
    """Parse one station; None if it is not in the list."""
    starts = [*_STATION.finditer(out)]
    for number, start in enumerate(starts):
        if start[1].upper() != bssid:
            continue
        end = starts[number + 1].start() if number + 1 < len(starts) else len(out)
        fields = dict(_fields(out[start.end() : end]))
        level, chains = _levels(fields.get("signal", ""))
        mean, _ = _levels(fields.get("signal avg", ""))
        return Station(
            signal_dbm=level if mean is None else mean,
            chains_dbm=chains,
            rx_mbps=_rate(fields.get("rx bitrate", "")),
            tx_mbps=_rate(fields.get("tx bitrate", "")),
        )
    return None


def read_type(out: str) -> str | None:
    """Parse the interface type from `iw dev INTERFACE info`: `managed`, `AP`, `monitor`."""
    match = _TYPE.search(out)
    return match[1] if match else None


def read_opened(out: str) -> OpenedRadio:
    """Parse the network of an access point from `iw dev INTERFACE info`."""
    mhz = _CHANNEL.search(out)
    ssid = _SSID.search(out)
    return OpenedRadio(read_type(out), _plain(ssid[1]) if ssid else None, int(mhz[1]) if mhz else None)


def read_stations(out: str) -> tuple[str, ...]:
    """Parse the stations authorised at an access point from `iw dev INTERFACE station dump`."""
    starts = [*_STATION.finditer(out)]
    ends = (*(start.start() for start in starts[1:]), len(out))
    blocks = ((start[1].upper(), out[start.end() : end]) for start, end in zip(starts, ends, strict=False))
    return tuple(mac for mac, block in blocks if dict(_fields(block)).get("authorized", "yes") != "no")


def read_width(out: str) -> int | None:
    """Read the channel's width in MHz from `iw dev INTERFACE info`."""
    match = _WIDTH.search(out)
    return int(match[1]) if match else None


def read_rules(out: str) -> Rules:
    """Read the countries of the system and of each radio."""
    return Rules(countries=tuple(_COUNTRY.findall(out)))


def _fields(text: str) -> Iterator[tuple[str, str]]:
    """Yield name and value of each line, only the first of each name."""
    seen_names = set()
    for name, value in _FIELD.findall(text):
        if name not in seen_names:
            seen_names.add(name)
            yield name, value


def _levels(text: str) -> tuple[float | None, tuple[float, ...]]:
    """Parse `-52 [-54, -57] dBm`; a driver without levels writes 0."""
    match = _LEVEL.match(text)
    if match is None:
        return None, ()
    chains = tuple(float(item) for item in re.findall(r"-\d+", match[2] or ""))
    return float(match[1]), chains


def _rate(text: str) -> float | None:
    match = _RATE.match(text)
    return float(match[1]) or None if match else None


def _plain(ssid: str) -> str:
    r"""Decode an SSID: iw writes bytes that are not plain ASCII as hex escapes."""
    raw = _ESCAPE.sub(lambda match: chr(int(match[1], 16)), ssid)
    return raw.encode("latin-1", "replace").decode("utf-8", "replace")


_NO_COUNTRY = frozenset({"00", "98", "99"})
"""Whole world, common part of several countries' rules, a driver's own rules (Linux, regulatory.c)."""
_BANDS = {"2ghz": (2400, 2500), "5ghz": (5150, 5900)}


def band_of(frequency_mhz: int) -> str | None:
    """Return the band, as in `site.channels`; None if it is neither 2.4 nor 5 GHz."""
    return next((name for name, (low, high) in _BANDS.items() if low <= frequency_mhz < high), None)


def judge_channel(country: str, frequency_mhz: int | None, width_mhz: int | None, who: str) -> Iterator[LinkFinding]:
    """Compare the channel with what may be used outdoors in the pilot's country."""
    if frequency_mhz is None:
        return
    band = band_of(frequency_mhz)
    if band is None:
        message = msg(f"{arg(who)} is on {arg(frequency_mhz)} MHz, which is neither 2.4 nor 5 GHz")
        hint = "the pilot agreed on 802.11a and g: not all its radios support this band"
        yield LinkFinding(Verdict.WARN, "band", message, hint)
    elif why := channels.why_illegal(country, band, frequency_mhz, width_mhz or 20, outdoors=True):
        message = msg(f"{arg(who)} is on {arg(frequency_mhz)} MHz: {arg(why)}")
        hint = "set another channel on the vehicle before it goes outside: 5500 to 5700 MHz, or 2.4 GHz"
        yield LinkFinding(Verdict.WARN, "channel-indoors", message, hint)


def judge_country(country: str, rules: Rules, where: str) -> Iterator[LinkFinding]:
    """Compare the regulatory country of the computer's radios with the pilot's; a missing one is not judged."""
    if country == channels.UNKNOWN:
        return
    country_code = channels.COUNTRY_CODES[country]
    others = [item for item in rules.countries if item not in {country_code, *_NO_COUNTRY}]
    hint = msg(
        f"there: sudo iw reg set {arg(country_code)}, and `REGDOMAIN={arg(country_code)}` in /etc/default/crda to make "
        "it permanent"
    )
    if others:
        message = msg(
            f"the radio of {arg(where)} uses the rules of {arg(others[0])}, but the pilot is in {arg(country_code)}"
        )
        yield LinkFinding(Verdict.WARN, "country-differs", message, hint)
    elif rules.countries and country_code not in rules.countries:
        message = msg(
            f"the radio of {arg(where)} uses the rules of no single country, but the pilot is in {arg(country_code)}"
        )
        yield LinkFinding(Verdict.WARN, "country-unset", message, hint)


FAR_DB = 10.0
IMBALANCE_DB = 6.0


def judge_level(endpoint: model.WifiEndpoint, level: float | None, who: str, where: str) -> Iterator[LinkFinding]:
    """Compare a level with both limits. `where` receives `who`."""
    if level is None:
        message = msg(f"{arg(where)} does not report the signal level of {arg(who)}")
        yield LinkFinding(Verdict.INCONCLUSIVE, "signal-unknown", message, "check the radio's own page, or check again")
    elif level < endpoint.low_dbm:
        far = level <= endpoint.low_dbm - FAR_DB
        message = msg(f"{arg(where)} receives {arg(who)} at {arg(level):g} dBm, below {arg(endpoint.low_dbm):g} dBm")
        hint = "bring both closer or into line of sight, and check the antennas and their connectors"
        yield LinkFinding(Verdict.FAIL if far else Verdict.WARN, "signal-weak", message, hint)
    elif level > endpoint.high_dbm:
        far = level >= endpoint.high_dbm + FAR_DB
        message = msg(
            f"{arg(where)} receives {arg(who)} at {arg(level):g} dBm, above {arg(endpoint.high_dbm):g} dBm: its "
            "receiver is overloaded"
        )
        hint = "move both a few metres apart, or reduce the transmit power of the other end"
        yield LinkFinding(Verdict.FAIL if far else Verdict.WARN, "signal-strong", message, hint)


def judge_chains(chains: Sequence[float | None], who: str, where: str) -> Iterator[LinkFinding]:
    """Compare the chains of the receiver with each other."""
    levels = [chain for chain in chains if chain is not None]
    if len(levels) > 1 and max(levels) - min(levels) > IMBALANCE_DB:
        apart = max(levels) - min(levels)
        message = msg(
            f"the chains of {arg(where)} receive {arg(who)} with {arg(apart):g} dB difference, more than "
            f"{arg(IMBALANCE_DB):g} dB"
        )
        hint = "check the alignment of the antennas, then the connector of the weaker chain"
        yield LinkFinding(Verdict.WARN, "chain-imbalance", message, hint)


def judge_rate(
    endpoint: model.WifiEndpoint, sent_mbps: float | None, received_mbps: float | None, who: str, where: str
) -> Iterator[LinkFinding]:
    """Compare the rates of the association with the minimum rate in the inventory.

    The transmit rate is the choice of this end's rate control, and counts; the last received frame may have been a
    management frame at the lowest rate, so the receive rate only warns.
    """
    floor = endpoint.rate_mbps
    if floor is None:
        return
    hint = "check again while traffic flows; then check level, channel and width"
    if sent_mbps is None and received_mbps is None:
        message = msg(f"{arg(where)} does not report its rate to {arg(who)}")
        yield LinkFinding(Verdict.INCONCLUSIVE, "rate-unknown", message, hint)
    elif sent_mbps is not None and sent_mbps < floor:
        message = msg(f"{arg(where)} sends to {arg(who)} at {arg(sent_mbps):g} Mbit/s, below {arg(floor):g} Mbit/s")
        yield LinkFinding(Verdict.FAIL, "rate-low", message, hint)
    elif received_mbps is not None and received_mbps < floor:
        message = msg(
            f"{arg(where)} last received from {arg(who)} at {arg(received_mbps):g} Mbit/s, below {arg(floor):g} Mbit/s"
        )
        yield LinkFinding(Verdict.WARN, "rate-low", message, hint)


FAIL_LOSS_PERCENT = 50.0
"""From this loss on, Wi-Fi is unusable: our own judgement. In between, the item warns."""


@dataclass(frozen=True, slots=True)
class AssociatedProbe:
    """Check that the radio is associated with the vehicle's access point, with a good level, and that it responds.

    Run on the gateway (or the laptop): `iw dev IF link`, `iw dev IF station dump`, `iw dev IF info`, `iw reg get`, `ip
    -j addr show dev IF`, and with an address `ip -j route get ADDRESS`, `ping -n -c 20 -i 0.2 -W 2 ADDRESS`.
    """

    name: str
    """Display name of the vehicle."""
    place: base.Place
    endpoint: model.WifiEndpoint
    address: str | None
    country: str
    """Country of the pilot, as RouterOS names it."""

    def asks(self) -> tuple[base.Question, ...]:
        """Return the requests about the radio, the interface and the route to the vehicle."""
        radio = self.endpoint.interface
        requests = (
            base.RunProgram("link", self.place, ("iw", "dev", radio, "link")),
            base.RunProgram("stations", self.place, ("iw", "dev", radio, "station", "dump")),
            base.RunProgram("info", self.place, ("iw", "dev", radio, "info")),
            base.RunProgram("rules", self.place, ("iw", "reg", "get")),
            ping.card_request(self.place, radio),
        )
        if self.address is None:
            return requests
        return (*requests, ping.route_request(self.place, self.address), ping.ping_request(self.place, self.address))

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the association first: without it no other reading concerns this vehicle."""
        addr = results.get("addr")
        absent = (*base.not_run(self.place, "ip", addr), *self._no_interface(addr), *self._no_iw(results.get("link")))
        if absent:
            return base.ProbeResult(absent[:1])
        link = self._link(results)
        if link is None:
            text = _program_output(results, "link").strip() or _error_output(results, "link").strip() or "nothing"
            message = msg(f"`iw` reports for {arg(self._radio)} something unknown: {arg(text.splitlines()[0][:100])}")
            hint = msg(f"run it there: iw dev {arg(self.endpoint.interface)} link")
            return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "association-unknown", message, hint),))
        if apart := self._apart(link, results):
            return base.ProbeResult((apart,), self._evidence(link, None))
        station = read_station(_program_output(results, "stations"), link.bssid or "")
        ping_result = self._judge_reachability(results)
        findings = (
            *self._check_identity(link, station),
            *self._check_radio(link, station, results),
            *ping_result.findings,
        )
        return base.ProbeResult(findings, (*self._evidence(link, station), *ping_result.evidence))

    @property
    def _radio(self) -> str:
        return msg(f"{arg(self.endpoint.interface)} of {arg(base.PLACES[self.place])}")

    def _no_interface(self, addr: base.Answer | None) -> Iterator[LinkFinding]:
        """Yield a finding if the interface is missing or switched off."""
        card = ping.read_card(addr)
        if isinstance(addr, base.CommandResult) and card is None and "does not exist" in addr.err:
            hint = "connect the radio, or correct `endpoints.wifi.interface`: `ip -br link` lists the interfaces"
            message = msg(f"{arg(base.PLACES[self.place])} has no interface {arg(self.endpoint.interface)}")
            yield LinkFinding(Verdict.FAIL, "no-interface", message, hint)
        elif card is not None and not card.up:
            hint = msg(f"there: rfkill list; sudo ip link set {arg(self.endpoint.interface)} up")
            yield LinkFinding(Verdict.FAIL, "interface-off", msg(f"{arg(self._radio)} is switched off"), hint)

    def _no_iw(self, link: base.Answer | None) -> Iterator[LinkFinding]:
        """Yield a finding if the radio cannot be read."""
        yield from base.not_run(self.place, "iw", link)
        if isinstance(link, base.CommandResult) and link.rc and "No such device" in link.err:
            hint = "correct `endpoints.wifi.interface`: `iw dev` lists the radios"
            message = msg(f"{arg(self.endpoint.interface)} of {arg(base.PLACES[self.place])} is not a radio")
            yield LinkFinding(Verdict.FAIL, "no-radio", message, hint)
        elif isinstance(link, base.CommandResult) and "nl80211 not found" in link.err:
            hint = "connect a radio, or load the driver of the installed one"
            message = msg(f"{arg(base.PLACES[self.place])} has no radio known to its kernel")
            yield LinkFinding(Verdict.FAIL, "no-radio", message, hint)

    def _link(self, results: Mapping[str, base.Answer]) -> WifiLink | None:
        return read_link(_program_output(results, "link"))

    def _apart(self, link: WifiLink, results: Mapping[str, base.Answer]) -> LinkFinding | None:
        """Return a finding if the radio is not associated with the vehicle, as far as known; otherwise None."""
        kind = read_type(_program_output(results, "info"))
        if link.bssid is None and kind is not None and kind != "managed":
            message = msg(f"{arg(self._radio)} is not a client of an access point, but of type {arg(kind)}")
            hint = msg(
                f"the vehicle is the access point here: find out what set {arg(self.endpoint.interface)} to this type"
            )
            return LinkFinding(Verdict.FAIL, "no-client", message, hint)
        if link.bssid is None:
            hint = msg(
                f"check that {arg(self.name)} is on and its antenna is out of the water; then compare SSID and key at "
                "both ends"
            )
            message = msg(f"{arg(self._radio)} is not associated with {arg(self._target_text)}")
            return LinkFinding(Verdict.FAIL, "not-associated", message, hint)
        ssid = self.endpoint.ssid
        if ssid is not None and link.ssid is not None and link.ssid != ssid:
            message = msg(
                f"{arg(self._radio)} is associated with `{arg(link.ssid)}`, and a radio can use only one access point: "
                f"`{arg(ssid)}` cannot be checked"
            )
            hint = msg(
                f"connect it to `{arg(ssid)}` when the other vehicle is done, or give each vehicle its own radio"
            )
            return LinkFinding(Verdict.INCONCLUSIVE, "other-association", message, hint)
        if self.endpoint.mac is not None and link.bssid != str(self.endpoint.mac).upper():
            message = msg(
                f"{arg(link.bssid)} sends as {arg(self._target_text)}, but the radio of {arg(self.name)} is "
                f"{arg(self.endpoint.mac)}"
            )
            hint = (
                "correct `endpoints.wifi.mac` if its radio was replaced; otherwise find out what sends under this name"
            )
            return LinkFinding(Verdict.FAIL, "other-radio", message, hint)
        return None

    @property
    def _target_text(self) -> str:
        return msg(
            f"`{arg(self.endpoint.ssid)}` of {arg(self.name)}"
            if self.endpoint.ssid
            else f"the access point of {arg(self.name)}"
        )

    def _check_identity(self, link: WifiLink, station: Station | None) -> Iterator[LinkFinding]:
        dbm = _signal_level(link, station)
        level = msg("" if dbm is None else f", signal {arg(dbm):g} dBm")
        who = f"`{link.ssid}`" if link.ssid else str(link.bssid)
        yield LinkFinding(
            Verdict.PASS,
            "associated",
            msg(f"{arg(self._radio)} is associated with {arg(who)} of {arg(self.name)}{arg(level)}"),
        )
        if (self.endpoint.ssid is None or link.ssid is None) and self.endpoint.mac is None:
            message = msg(f"cannot tell whether {arg(who)} is the access point of {arg(self.name)}")
            yield LinkFinding(Verdict.WARN, "whose-unknown", message, "set its `ssid`, or the `mac` of its radio")

    def _check_radio(
        self, link: WifiLink, station: Station | None, results: Mapping[str, base.Answer]
    ) -> Iterator[LinkFinding]:
        yield from judge_level(self.endpoint, _signal_level(link, station), self.name, self._radio)
        yield from judge_chains(station.chains_dbm if station else (), self.name, self._radio)
        sent_mbps, received_mbps = _rates(link, station)
        yield from judge_rate(self.endpoint, sent_mbps, received_mbps, self.name, self._radio)
        width = read_width(_program_output(results, "info"))
        yield from judge_channel(self.country, link.frequency_mhz, width, self.name)
        rules = read_rules(_program_output(results, "rules"))
        yield from judge_country(self.country, rules, base.PLACES[self.place])

    def _judge_reachability(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the ping; packets routed over another interface prove nothing about the radio."""
        if self.address is None:
            message = msg(f"no address of {arg(self.name)} is known: loss and round trip were not measured")
            hint = "reserve one in `site.lan.reservations`, or set `endpoints.wifi.address`"
            return base.ProbeResult((LinkFinding(Verdict.WARN, "no-address", message, hint),))
        way = ping.read_route(results.get("route"), self.address)
        card = ping.read_card(results.get("addr"))
        mine = {self.endpoint.interface, card.master if card else None}
        if way is not None and way.interface not in mine:
            message = msg(
                f"packets to {arg(self.name)} ({arg(self.address)}) leave by {arg(way.interface)} instead of "
                f"{arg(self._radio)}"
            )
            hint = msg(f"run it there: ip route get {arg(self.address)}; then correct the address or the route")
            return base.ProbeResult(
                (LinkFinding(Verdict.FAIL, "other-way", message, hint),), (base.read("way", way.interface),)
            )
        if way is None and not tuple(base.not_run(self.place, "ip", results.get("route"))):
            message = msg(f"{arg(base.PLACES[self.place])} has no route to {arg(self.name)} ({arg(self.address)})")
            hint = msg(f"check there that {arg(self.endpoint.interface)} has an address: ip -br addr")
            return base.ProbeResult((LinkFinding(Verdict.FAIL, "no-route", message, hint),))
        target = ping.NeighbourPing(self.name, self.address, self.place, self.endpoint.loss_percent, FAIL_LOSS_PERCENT)
        return ping.judge_ping(target, results.get("ping"))

    def _evidence(self, link: WifiLink, station: Station | None) -> tuple[report.Evidence, ...]:
        at = self._radio
        sent_mbps, received_mbps = _rates(link, station)
        values = (
            (
                msg(f"access point received by {arg(at)}"),
                msg(f"{arg(link.ssid or '?')} ({arg(link.bssid)})" if link.bssid else "none"),
                "",
            ),
            (msg(f"channel of {arg(at)}"), link.frequency_mhz, "MHz"),
            (msg(f"signal at {arg(at)}"), _signal_level(link, station), "dBm"),
            (
                msg(f"chains of {arg(at)}"),
                join(", ", (f"{item:g}" for item in station.chains_dbm)) if station else None,
                "dBm",
            ),
            (msg(f"transmit rate of {arg(at)}"), sent_mbps, "Mbit/s"),
            (msg(f"receive rate of {arg(at)}"), received_mbps, "Mbit/s"),
        )
        result = tuple(base.read(what, value, unit) for what, value, unit in values if value not in {None, ""})
        bounds = msg(f"{arg(self.endpoint.low_dbm):g} to {arg(self.endpoint.high_dbm):g} dBm")
        return (*result, base.declared_evidence("expected signal", bounds))


def _signal_level(link: WifiLink, station: Station | None) -> float | None:
    mean = None if station is None else station.signal_dbm
    return link.signal_dbm if mean is None else mean


def _rates(link: WifiLink, station: Station | None) -> tuple[float | None, float | None]:
    return (
        link.tx_mbps if link.tx_mbps is not None or station is None else station.tx_mbps,
        link.rx_mbps if link.rx_mbps is not None or station is None else station.rx_mbps,
    )


def _program_output(results: Mapping[str, base.Answer], name: str) -> str:
    ran = results.get(name)
    return ran.out if isinstance(ran, base.CommandResult) and ran.trouble is None else ""


def _error_output(results: Mapping[str, base.Answer], name: str) -> str:
    ran = results.get(name)
    return ran.err if isinstance(ran, base.CommandResult) else ""


@dataclass(frozen=True, slots=True)
class RegisteredProbe:
    """Check that the vehicle is registered at the site's access point, with a good level, and responds.

    Read from the RouterOS device `seen_by`: the registration tables of both generations; on the gateway (or the
    laptop): `ip -j route get ADDRESS` and `ping -n -c 20 -i 0.2 -W 2 ADDRESS`. Without `seen_by` only these.
    """

    name: str
    place: base.Place
    endpoint: model.WifiEndpoint
    address: str | None
    mac: str | None
    """Radio of the vehicle, upper case; None: not declared."""

    def asks(self) -> tuple[base.Question, ...]:
        """Return the requests for the registration tables, and the ping."""
        host = self.endpoint.seen_by
        tables = () if host is None else tuple(base.RouterOsQuery(f, host, wifi.queries(f, "")[0]) for f in wifi.Family)
        if self.address is None:
            return tables
        return (*tables, ping.route_request(self.place, self.address), ping.ping_request(self.place, self.address))

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the access point's data, then the ping; if no access point can be read, the ping comes first."""
        parts = [self._check_registration(results), self._judge_reachability(results)]
        if self.endpoint.seen_by is None:
            parts.reverse()
        findings = tuple(finding for part in parts for finding in part.findings)
        return base.ProbeResult(findings, tuple(evidence for part in parts for evidence in part.evidence))

    def _check_registration(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        host = self.endpoint.seen_by
        if host is None:
            message = msg(f"no device in the inventory sees the association of {arg(self.name)}, nor its signal")
            hint = "only its ping was checked: set `endpoints.wifi.seen_by` to the access point's RouterOS device"
            return base.ProbeResult((LinkFinding(Verdict.WARN, "association-unseen", message, hint),))
        answers = {family: results.get(family) for family in wifi.Family}
        if all(not isinstance(result, base.Rows) or result.trouble is not None for result in answers.values()):
            return base.ProbeResult((base.no_answer_finding(host, answers[wifi.Family.WIRELESS]),))
        tables = {family: rows for family, answer in answers.items() if (rows := base.rows_of(answer)) is not None}
        if not tables:
            message = msg(f"{arg(host)} has no registration table in either of its radio menus")
            hint = (
                "check that `endpoints.wifi.seen_by` is the device with the access point; from RouterOS 7.13 it "
                "needs a package"
            )
            return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "no-radio", message, hint),))
        peers = [peer for family, rows in tables.items() for peer in wifi.read(family, rows, None).peers]
        return self._judge_registration(host, peers)

    def _judge_registration(self, host: str, peers: list[wifi.WifiPeer]) -> base.ProbeResult:
        others = msg(f"{arg(len(peers))} other{'' if len(peers) == 1 else 's'}" if peers else "none")
        if self.mac is None:
            message = msg(
                f"the inventory has no MAC address of {arg(self.name)}, which {arg(host)} needs to recognise it"
            )
            hint = "set `endpoints.wifi.mac`, or reserve its address in `site.lan.reservations`"
            return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "mac-unknown", message, hint),))
        mine = next((peer for peer in peers if peer.mac == self.mac), None)
        if mine is None:
            message = msg(
                f"{arg(self.name)} ({arg(self.mac)}) is not registered at {arg(host)}; registered there: {arg(others)}"
            )
            hint = (
                "check that it is on, with the SSID and key of the site; if its radio was replaced, correct its "
                "MAC address"
            )
            return base.ProbeResult(
                (LinkFinding(Verdict.FAIL, "not-registered", message.replace("others is", "others are"), hint),)
            )
        return base.ProbeResult(tuple(self._findings(host, mine)), self._evidence(host, mine))

    def _findings(self, host: str, peer: wifi.WifiPeer) -> Iterator[LinkFinding]:
        if peer.is_authorised is False:
            message = msg(f"{arg(self.name)} is registered at {arg(host)}, but not authorised: the keys differ")
            yield LinkFinding(Verdict.FAIL, "not-authorised", message, "compare the key of the vehicle with the site's")
        else:
            level = msg("" if peer.signal_dbm is None else f", signal {arg(peer.signal_dbm):g} dBm")
            yield LinkFinding(
                Verdict.PASS, "registered", msg(f"{arg(self.name)} is registered at {arg(host)}{arg(level)}")
            )
        yield from judge_level(self.endpoint, peer.signal_dbm, self.name, host)
        yield from judge_chains(peer.chains_dbm, self.name, host)
        yield from judge_rate(self.endpoint, peer.tx_rate_mbps, peer.rx_rate_mbps, self.name, host)

    def _evidence(self, host: str, peer: wifi.WifiPeer) -> tuple[report.Evidence, ...]:
        chains = join(", ", ("?" if item is None else f"{item:g}" for item in peer.chains_dbm))
        values = (
            (msg(f"station registered at {arg(host)}"), peer.mac, ""),
            (msg(f"signal at {arg(host)}"), peer.signal_dbm, "dBm"),
            (msg(f"chains of {arg(host)}"), chains or None, "dBm"),
            (msg(f"signal-to-noise ratio at {arg(host)}"), peer.snr_db, "dB"),
            (msg(f"transmit rate of {arg(host)}"), peer.tx_rate_mbps, "Mbit/s"),
            (msg(f"receive rate of {arg(host)}"), peer.rx_rate_mbps, "Mbit/s"),
            (msg(f"time since registration, at {arg(host)}"), peer.uptime_s, "s"),
        )
        result = tuple(base.read(what, value, unit) for what, value, unit in values if value is not None)
        bounds = msg(f"{arg(self.endpoint.low_dbm):g} to {arg(self.endpoint.high_dbm):g} dBm")
        return (*result, base.declared_evidence("expected signal", bounds))

    def _judge_reachability(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        if self.address is None:
            message = msg(f"no address of {arg(self.name)} is known: loss and round trip were not measured")
            hint = "reserve one in `site.lan.reservations`, or set `endpoints.wifi.address`"
            return base.ProbeResult((LinkFinding(Verdict.WARN, "no-address", message, hint),))
        way = ping.read_route(results.get("route"), self.address)
        if local := tuple(ping.own_address(self.place, self.name, self.address, way)):
            return base.ProbeResult(local)
        target = ping.NeighbourPing(self.name, self.address, self.place, self.endpoint.loss_percent, FAIL_LOSS_PERCENT)
        return ping.judge_ping(target, results.get("ping"))


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return the steps on a location's bridges, and on the row's own Wi-Fi if it is in the inventory."""
    bridges = link_steps(
        cell,
        model.Column.WIFI,
        lambda link: msg(
            f"Wi-Fi bridge {arg(link.name)} of {arg(cell.name)} carries traffic, with a good signal at both ends"
        ),
    )
    endpoint = cell.wifi
    if endpoint is not None:
        return (*bridges, _radio_step(cell, endpoint, "own" if bridges else ""))
    return bridges or (() if cell.vehicle is not None else (_manual_step(cell),))


def _radio_step(cell: base.Cell, endpoint: model.WifiEndpoint, name: str) -> base.Step:
    probe = _probe(cell, endpoint)
    gateway = cell.gateway
    concerns = (endpoint.seen_by, gateway.name if gateway is not None else None)
    return base.Step(
        name=name,
        title=_title(cell, endpoint),
        kind=report.ItemKind.AUTOMATIC,
        phase=report.Phase.BENCH,
        probe=probe,
        concerns=tuple(concern for concern in concerns if concern is not None),
    )


def _title(cell: base.Cell, endpoint: model.WifiEndpoint) -> str:
    if endpoint.role is model.WifiRole.ACCESS_POINT:
        return msg(f"Access point of {arg(cell.name)} has a good signal, and responds without loss")
    if endpoint.seen_by is None:
        return msg(f"{arg(cell.name)} responds over the Wi-Fi of the site without loss")
    return msg(
        f"{arg(cell.name)} is registered at {arg(endpoint.seen_by)}, has a good signal, and responds without loss"
    )


def _probe(cell: base.Cell, endpoint: model.WifiEndpoint) -> base.Probe:
    place, address = cell.place(endpoint.seen_from), cell.address(endpoint.address)
    if endpoint.role is model.WifiRole.ACCESS_POINT:
        return AssociatedProbe(cell.name, place, endpoint, address, cell.inventory.pilot.country)
    return RegisteredProbe(cell.name, place, endpoint, address, reserved_mac(cell, endpoint.mac))


def _manual_step(cell: base.Cell) -> base.Step:
    return base.Step(
        name="",
        title=msg(f"Wi-Fi of {arg(cell.name)} works"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.BENCH,
        do=msg(
            f"Connect a computer to the Wi-Fi of {arg(cell.name)} where the vehicles will be, and check its signal "
            "level."
        ),
        look_for="It connects, receives the access point at -35 to -75 dBm, and pings the gateway without loss.",
    )
