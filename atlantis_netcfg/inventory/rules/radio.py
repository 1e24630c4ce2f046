"""Rules for the directional Wi-Fi bridge: legal channels, valid settings, matching ends, suitable power."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import alternatives, arg, conjunction, join, msg
from atlantis_netcfg.inventory import _draft, channels, findings, model
from atlantis_netcfg.inventory._yaml import SealedSecret

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.core.secret import Secret

_SHARED_KEYS = ("ssid", "protocol", "standard", "band", "frequency_mhz", "width_mhz", "country", "outdoor", "wpa")
"""Settings that both ends must share, besides the key."""
_WIDEST = {"2ghz": 40, "5ghz": 80}
_KEY_CHARACTERS = range(8, 64)
"""Length of a WPA2 passphrase (IEEE 802.11, annex M.4); RouterOS accepts the same for nv2."""


def _radios(draft: _draft.Draft) -> Iterator[tuple[str, _draft.Part, model.Ptp]]:
    for host, _, cpe in draft.valid_devices(model.Cpe):
        yield host, _draft.Part("device", host), cpe.ptp


def _transmitters(draft: _draft.Draft) -> Iterator[tuple[_draft.Part, str, model.WifiRadio]]:
    """Yield every radio subject to regulation and hardware limits, with the block that configures it."""
    for _, part, ptp in _radios(draft):
        yield part, "ptp", ptp
    for host, device in draft.devices.items():
        if isinstance(device, model.Router | model.Switch | model.Gateway) and device.access_point is not None:
            yield _draft.Part("device", host), "access_point", device.access_point


def standard_and_band(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the Wi-Fi standard exists in the radio's band."""
    for part, block, radio in _transmitters(draft):
        bands = channels.BANDS[radio.standard]
        if radio.band not in bands:
            message = msg(f"{arg(radio.standard)} is a standard of {arg(conjunction(bands))}, not of {arg(radio.band)}")
            fitting = [standard for standard, its in channels.BANDS.items() if radio.band in its]
            hint = msg(f"write `band: {arg(bands[0])}`, or one of {arg(join(', ', fitting))}")
            yield draft.finding_at(part, (block, "standard"), message, hint)


def width(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a channel width that the standard and the band allow."""
    for part, block, radio in _transmitters(draft):
        widths = [item for item in channels.WIDTHS[radio.standard] if item <= _WIDEST[radio.band]]
        if radio.width_mhz not in widths:
            message = msg(f"{arg(radio.standard)} at {arg(radio.band)} has no channels of {arg(radio.width_mhz)} MHz")
            yield draft.finding_at(
                part, (block, "width_mhz"), message, msg(f"choose {arg(alternatives(map(str, widths)))}")
            )


def protocol_and_standard(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Refuse nv2 and nstreme with 802.11ax: only the package `wireless` has them (MikroTik manual, WiFi)."""
    for _, part, ptp in _radios(draft):
        if ptp.standard == "802.11ax" and ptp.protocol is not model.PtpProtocol.IEEE_80211:
            message = msg(f"an 802.11ax device does not support {arg(ptp.protocol)}")
            yield draft.finding_at(part, ("ptp", "protocol"), message, 'write "802.11", or choose an older standard')


def refuse_nstreme(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Refuse nstreme: it needs extra settings, and nv2 serves its purpose better (MikroTik manual, Nv2)."""
    for _, part, ptp in _radios(draft):
        if ptp.protocol is model.PtpProtocol.NSTREME:
            message = "nstreme is not supported by this toolkit"
            yield draft.finding_at(part, ("ptp", "protocol"), message, 'write nv2, or "802.11"')


def menus(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the radio's settings exist in the chosen family of RouterOS menus."""
    for _, part, ptp in _radios(draft):
        if ptp.menus is model.RadioMenus.WIFI and ptp.protocol is model.PtpProtocol.NV2:
            message = "the `wifi` menus do not support nv2"
            hint = 'write `menus: wireless`, or `protocol: "802.11"` at both ends'
        elif ptp.menus is model.RadioMenus.WIRELESS and ptp.standard == "802.11ax":
            message = "the `wireless` menus do not support 802.11ax"
            hint = "write `menus: wifi` or `menus: auto`, or choose an older standard"
        else:
            continue
        yield draft.finding_at(part, ("ptp", "menus"), message, hint)


def menus_of_an_access_point(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Refuse 802.11ax and WPA3 for an access point in the older `wireless` menus."""
    for host, device in draft.devices.items():
        radio = device.access_point if isinstance(device, model.Router | model.Switch) else None
        part = _draft.Part("device", host)
        if radio is None or radio.menus != "wireless":
            continue
        for name, value in (("standard", "802.11ax"), ("wpa", "wpa3")):
            if getattr(radio, name) == value:
                hint = "write `menus: wifi` if the router has them, or choose an older standard"
                yield draft.finding_at(
                    part, ("access_point", name), msg(f"the `wireless` menus do not support {arg(value)}"), hint
                )


def same_menus(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require the same driver at both ends (MikroTik manual, WiFi: station-bridge); reported at the second end."""
    for host, part, ptp in _radios(draft):
        other = draft.devices.get(ptp.peer)
        if not isinstance(other, model.Cpe) or other.ptp.peer != host or not _is_second_end(draft, host, ptp.peer):
            continue
        if {ptp.menus, other.ptp.menus} == {model.RadioMenus.WIRELESS, model.RadioMenus.WIFI}:
            where = draft.where(_draft.Part("device", ptp.peer), "ptp", "menus")
            message = msg(
                f"`menus` is {arg(ptp.menus)} here and {arg(other.ptp.menus)} at the other end ({arg(where)})"
            )
            hint = "a bridge needs the same driver at both ends: use two devices of one family"
            yield draft.finding_at(part, ("ptp", "menus"), message, hint)


def wpa(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Refuse WPA3 outside 802.11 in the `wifi` menus; nv2 has its own key."""
    for _, part, ptp in _radios(draft):
        if ptp.wpa != "wpa3":
            continue
        if ptp.menus is model.RadioMenus.WIRELESS:
            yield draft.finding_at(
                part, ("ptp", "wpa"), "the `wireless` menus do not support wpa3", "write `wpa: wpa2`"
            )
        elif ptp.protocol is model.PtpProtocol.NV2:
            message = "nv2 has its own key, and no wpa3"
            yield draft.finding_at(part, ("ptp", "wpa"), message, 'remove `wpa`, or write `protocol: "802.11"`')


def _channel(radio: model.WifiRadio) -> tuple[str, str, int, int]:
    return radio.country, radio.band, radio.frequency_mhz, radio.width_mhz


def channel(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a channel that exists in the band and is legal in the radio's country."""
    for part, block, radio in _transmitters(draft):
        legal_channels = channels.legal(radio.country, radio.band, radio.width_mhz, outdoors=radio.outdoor)
        where = "outdoors" if radio.outdoor else "indoors"
        hint = msg(
            f"channels {arg(where)} in {arg(radio.country)}: {arg(findings.choices(map(str, legal_channels)))}"
            if legal_channels
            else "choose a smaller width"
        )
        if not channels.is_channel(radio.band, radio.frequency_mhz):
            message = msg(f"{arg(radio.frequency_mhz)} MHz is not a channel of {arg(radio.band)}")
            yield draft.finding_at(part, (block, "frequency_mhz"), message, hint)
        elif why := channels.why_illegal(
            radio.country, radio.band, radio.frequency_mhz, radio.width_mhz, outdoors=radio.outdoor
        ):
            message = msg(
                f"{arg(radio.frequency_mhz)} MHz with {arg(radio.width_mhz)} MHz width is not legal {arg(where)} in "
                f"{arg(radio.country)}"
            )
            yield draft.finding_at(part, (block, "frequency_mhz"), msg(f"{arg(message)}: {arg(why)}"), hint)


def country(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that a radio's country is the pilot's."""
    if draft.pilot is None:
        return
    for part, block, radio in _transmitters(draft):
        if radio.country != draft.pilot.country:
            where = draft.where(_draft.Part("pilot"), "country")
            message = msg(
                f"the radio's country is {arg(radio.country)}, the pilot's is {arg(draft.pilot.country)} ({arg(where)})"
            )
            yield draft.finding_at(part, (block, "country"), message, "make both equal")


def require_known_rules(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a country with known rules where the inventory has radios."""
    if draft.pilot is not None and not draft.pilot.example_values:
        yield from _unknown_rules(draft, draft.pilot)


def warn_of_unknown_rules(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Report a country without known rules where the inventory is for rehearsals only."""
    if draft.pilot is not None and draft.pilot.example_values:
        yield from _unknown_rules(draft, draft.pilot)


def _unknown_rules(draft: _draft.Draft, pilot: model.Pilot) -> Iterator[findings.Finding]:
    has_radios = any(_transmitters(draft)) or any(vehicle.endpoints.wifi for vehicle in draft.vehicles.values())
    if pilot.country == channels.UNKNOWN and has_radios:
        message = "the radio rules of the country are unknown: rehearsals use the European ones, real runs are refused"
        hint = (
            "write the country; if it is not available, ask its authority for the channels and their power, and enter "
            "them in atlantis_netcfg/inventory/channels.py"
        )
        yield draft.finding_at(_draft.Part("pilot"), ("country",), message, hint)


def key(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a key that both ends accept; an encrypted key cannot be checked."""
    for part, block, radio in _transmitters(draft):
        if not is_passphrase(radio.key):
            message = "the bridge's key must have 8 to 63 printable ASCII characters"
            if block != "ptp":
                message = "the access point's key must have 8 to 63 printable ASCII characters"
            yield draft.finding_at(part, (block, "key"), message, "create another key")


def is_passphrase(key: Secret) -> bool:
    """Return whether radios accept the key; an encrypted key cannot be checked and counts as valid."""
    if isinstance(key, SealedSecret):
        return True
    text = key.reveal()
    return len(text) in _KEY_CHARACTERS and text.isascii() and text.isprintable()


def peers(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the two ends of a bridge name each other as peer."""
    others = [host for host in draft.layout.hosts if draft.kind_of(host) == "cpe"]
    for host, part, ptp in _radios(draft):
        other_ends = [name for name in others if name != host]
        peer = draft.devices.get(ptp.peer)
        if ptp.peer not in draft.layout.hosts:
            problem = (
                msg(f"host `{arg(ptp.peer)}` does not exist"),
                findings.suggest(ptp.peer, other_ends, none="add it to hosts.yml"),
            )
        elif ptp.peer == host:
            problem = (
                msg(f"`{arg(host)}` is its own peer"),
                msg(f"name the other end: {arg(findings.choices(other_ends))}"),
            )
        elif draft.kind_of(ptp.peer) not in {"cpe", None}:
            message = msg(f"`{arg(ptp.peer)}` is a {arg(draft.kind_of(ptp.peer))}, not the other end of the bridge")
            problem = (message, msg(f"name the other end: {arg(findings.choices(other_ends))}"))
        elif isinstance(peer, model.Cpe) and peer.ptp.peer not in {host, ptp.peer} and peer.ptp.peer in others:
            where = draft.where(_draft.Part("device", ptp.peer), "ptp", "peer")
            problem = (
                msg(f"the peer `{arg(ptp.peer)}` has another peer, `{arg(peer.ptp.peer)}` ({arg(where)})"),
                "set each as the peer of the other",
            )
        else:
            continue
        yield draft.finding_at(part, ("ptp", "peer"), *problem)


def agree(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require the same radio settings at both ends, which otherwise do not connect; reported at the second end."""
    for host, part, ptp in _radios(draft):
        other = draft.devices.get(ptp.peer)
        if not isinstance(other, model.Cpe) or other.ptp.peer != host or not _is_second_end(draft, host, ptp.peer):
            continue
        first = _draft.Part("device", ptp.peer)
        shared_keys = (
            _SHARED_KEYS if draft.pilot is None else [item for item in _SHARED_KEYS if item != "country"]
        )  # else told by `country`
        for name in shared_keys:
            here, there = getattr(ptp, name), getattr(other.ptp, name)
            if here != there:
                text = msg(
                    f"`{arg(name)}` is {arg(_format_value(here))} here and {arg(_format_value(there))} at the other end"
                )
                message = msg(f"{arg(text)} ({arg(draft.where(first, 'ptp', name))})")
                yield draft.finding_at(part, ("ptp", name), message, "make both ends the same")
        is_sealed = isinstance(ptp.key, SealedSecret) or isinstance(other.ptp.key, SealedSecret)
        if not is_sealed and ptp.key != other.ptp.key:
            message = msg(f"the key differs from the other end's ({arg(draft.where(first, 'ptp', 'key'))})")
            yield draft.finding_at(part, ("ptp", "key"), message, "make both ends the same")
        if ptp.mode is other.ptp.mode:
            both = msg(f"both ends are {arg(ptp.mode)} ({arg(draft.where(first, 'ptp', 'mode'))})")
            opposite = next(mode for mode in model.PtpMode if mode is not ptp.mode)
            yield draft.finding_at(part, ("ptp", "mode"), both, msg(f"write `mode: {arg(opposite)}` at one of them"))


def _is_second_end(draft: _draft.Draft, host: str, peer: str) -> bool:
    order = list(draft.layout.hosts)
    return order.index(host) > order.index(peer)


def _format_value(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value}"


def check_bridge_radios(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that a bridge's radios are those of the link's two ends."""
    for name, site in draft.sites.items():
        for index, link in enumerate(site.served_links):
            far = draft.sites.get(link.carries)
            here = draft.devices.get(link.device)
            carried_boxes = (
                {site_link.device for site_link in far.bearers if site_link.kind.traits.bridge}
                if far is not None
                else set()
            )
            peer = here.ptp.peer if isinstance(here, model.Cpe) else None
            is_known_peer = peer is not None and draft.kind_of(peer) == "cpe" and peer != link.device
            if is_known_peer and carried_boxes and None not in carried_boxes and peer not in carried_boxes:
                message = msg(
                    f"`{arg(link.device)}` points at `{arg(peer)}`, which is not the radio of the bridge at "
                    f"`{arg(link.carries)}`"
                )
                hint = msg(
                    f"its peer must be {arg(findings.choices(str(item) for item in carried_boxes))}: correct `peer` "
                    "or `carries`"
                )
                yield draft.finding_at(_draft.Part("site", name), ("served_links", index, "device"), message, hint)


RULES: tuple[_draft.Rule, ...] = (
    standard_and_band,
    width,
    protocol_and_standard,
    refuse_nstreme,
    menus,
    menus_of_an_access_point,
    same_menus,
    wpa,
    channel,
    country,
    require_known_rules,
    key,
    peers,
    agree,
    check_bridge_radios,
)
WARNINGS: tuple[_draft.Rule, ...] = (warn_of_unknown_rules,)

_SHORT_M = 500
_LIGHT_M_S = 299_792_458.0
_AIM_DBM = -50
"""Target level for the transmit power in a hint: the middle of the healthy range."""


def _lost_db(ptp: model.Ptp, distance_m: int) -> float:
    return 20 * math.log10(4 * math.pi * distance_m * ptp.frequency_mhz * 1e6 / _LIGHT_M_S)


def bounds(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the weakest signal level is below the strongest."""
    for _, part, ptp in _radios(draft):
        if ptp.signal.weakest_dbm >= ptp.signal.strongest_dbm:
            message = msg(f"the weakest level, {arg(ptp.signal.weakest_dbm)} dBm, is not below the strongest")
            message += f", {ptp.signal.strongest_dbm} dBm"
            yield draft.finding_at(part, ("ptp", "signal"), message, "swap them: -75 dBm is weaker than -35 dBm")


def eirp(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the radiated power (EIRP: power plus antenna gain) is within the country's limit for the channel."""
    for part, block, radio in _transmitters(draft):
        if radio.tx_power_dbm is None or radio.antenna_gain_dbi is None:
            continue
        limit = channels.eirp_dbm(
            radio.country, radio.band, radio.frequency_mhz, radio.width_mhz, outdoors=radio.outdoor
        )
        if limit is not None and radio.tx_power_dbm + radio.antenna_gain_dbi > limit:
            message = msg(
                f"{arg(radio.tx_power_dbm)} dBm with an antenna of {arg(radio.antenna_gain_dbi)} dBi radiates"
            )
            message += msg(
                f" {arg(radio.tx_power_dbm + radio.antenna_gain_dbi)} dBm; {arg(radio.country)} allows {arg(limit):g} "
                "dBm"
            )
            message += msg(f" at {arg(radio.frequency_mhz)} MHz")
            most = int(limit) - radio.antenna_gain_dbi
            hint = msg(f"write `tx_power_dbm: {arg(most)}` or less" if most >= 0 else "use an antenna with less gain")
            yield draft.finding_at(part, (block, "tx_power_dbm"), message, hint)


def short_link(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require `tx_power_dbm` on a short link: at the country's limit it would overdrive the other receiver."""
    for _, part, ptp in _radios(draft):
        if ptp.distance_m is None or ptp.distance_m >= _SHORT_M or ptp.tx_power_dbm is not None:
            continue
        message = msg(
            f"over {arg(ptp.distance_m)} m, full power overdrives the other receiver: `tx_power_dbm` must be set"
        )
        yield draft.finding_at(part, ("ptp", "distance_m"), message, _power(ptp, ptp.distance_m))


def _power(ptp: model.Ptp, distance_m: int) -> str:
    """Return a hint with a transmit power for a good signal, within the legal limit, if both ends have this antenna."""
    gain = ptp.antenna_gain_dbi
    if gain is None:
        return "set `antenna_gain_dbi` to the gain of the antenna, and `tx_power_dbm`: start low, for example at 5"
    between = 2 * gain - _lost_db(ptp, distance_m)
    limit = channels.eirp_dbm(*_channel(ptp), outdoors=ptp.outdoor)
    power = max(0, round(_AIM_DBM - between))
    if limit is not None and power + gain > limit:
        most = max(0, int(limit) - gain)
        return msg(
            f"the law allows `tx_power_dbm: {arg(most)}`, received at about {arg(most + between):.0f} dBm: use larger "
            "antennas"
        )
    return msg(
        f"write `tx_power_dbm: {arg(power)}`, received at the other end at about {arg(power + between):.0f} dBm in "
        "free space"
    )


def level(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the calculated free-space level is within the bounds that the other end sets.

    A real link is some decibels weaker: 20 log10(4 pi d / wavelength) is lost between the antennas (ITU-R P.525). Too
    strong a signal disturbs the receiver as well: on a link of 150 m full power overdrives it.
    """
    for host, part, ptp in _radios(draft):
        other = draft.devices.get(ptp.peer)
        distance_m = ptp.distance_m
        if not isinstance(other, model.Cpe) or other.ptp.peer != host or distance_m is None:
            continue
        gains = (ptp.antenna_gain_dbi, other.ptp.antenna_gain_dbi)
        if ptp.tx_power_dbm is None or gains[0] is None or gains[1] is None:
            continue
        received_dbm = ptp.tx_power_dbm + gains[0] + gains[1] - _lost_db(ptp, distance_m)
        signal = other.ptp.signal
        if signal.weakest_dbm >= signal.strongest_dbm:
            continue  # told by `bounds`
        if received_dbm > signal.strongest_dbm:
            what, bound = "above its strongest level", signal.strongest_dbm
        elif received_dbm < signal.weakest_dbm:
            what, bound = "below its weakest level", signal.weakest_dbm
        else:
            continue
        where = draft.where(_draft.Part("device", ptp.peer), "ptp", "signal")
        message = msg(
            f"`{arg(ptp.peer)}` would receive {arg(received_dbm):.0f} dBm over {arg(distance_m)} m, {arg(what)} in the "
            f"inventory, {arg(bound)} dBm ({arg(where)})"
        )
        yield draft.finding_at(part, ("ptp", "tx_power_dbm"), message, _power(ptp, distance_m))


EIRP_RULES: tuple[_draft.Rule, ...] = (bounds, eirp, short_link, level)
