"""The access point on a radio of the gateway is active, and only known stations have joined it.

`iw` reports the current state of the radio. Client isolation is set in hostapd's file, which drift compares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.checklist.probes.wifi import read_opened, read_stations
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.links import LinkFinding

_NO_DEVICE = "No such device"


def access_point_check(site: parse.OwnSite) -> tuple[base.Step, ...]:
    """Return one step if the gateway has an access point in the inventory; otherwise none."""
    gateway = site.gateway
    if gateway is None or not isinstance(gateway.device, model.Gateway) or gateway.device.access_point is None:
        return ()
    radio = gateway.device.access_point
    title = msg(f"The gateway's network {arg(radio.ssid)} is open only to vehicles of the inventory")
    return (parse.step("access-point", title, _OpenNetwork(site, gateway.name, radio), (gateway.name,)),)


@dataclass(frozen=True, slots=True)
class _OpenNetwork:
    """Check that the gateway's access point is active, for vehicles in the inventory only."""

    site: parse.OwnSite
    gateway: str
    radio: model.GatewayAccessPoint

    def asks(self) -> tuple[base.Question, ...]:
        name = self.radio.interface
        return (
            *parse.run("info", self.site, f"iw dev {name} info"),
            *parse.run("stations", self.site, f"iw dev {name} station dump"),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        info, dump = results["info"], results["stations"]
        if isinstance(info, base.CommandResult) and info.trouble is None and _NO_DEVICE in info.err:
            message = msg(f"{arg(self.gateway)} has no radio {arg(self.radio.interface)}")
            return base.ProbeResult(
                (parse.fail("radio-missing", message, "connect it, or correct `access_point.interface`"),)
            )
        text, station_dump = parse.get_output(info, self.gateway), parse.get_output(dump, self.gateway)
        if not isinstance(text, str):
            return base.ProbeResult((text,))
        findings = [*self._network(text)]
        if isinstance(station_dump, str):
            findings += self._strangers(station_dump)
        else:
            findings.append(station_dump)
        stations = [*read_stations(station_dump)] if isinstance(station_dump, str) else []
        count = "nobody" if not stations else f"{len(stations)}"
        return base.ProbeResult(tuple(findings), (parse.read(msg(f"joined {arg(self.radio.ssid)}"), count),))

    def _network(self, text: str) -> Iterator[LinkFinding]:
        """Yield findings on the radio: hostapd makes it an access point; during radar detection it has no name yet."""
        network, name = read_opened(text), msg(f"{arg(self.radio.interface)} of {arg(self.gateway)}")
        hint = msg(f"check there: systemctl status atlantis-access-point@{arg(self.radio.interface)}")
        if network.type is None:
            yield parse.unreadable(self.gateway, self.radio.interface)
        elif network.type != "AP":
            yield parse.fail(
                "network-closed", msg(f"{arg(name)} is not an access point: it is of type {arg(network.type)}"), hint
            )
        elif network.ssid is None:
            message = msg(
                f"{arg(name)} is an access point that does not broadcast its name yet: it may be listening for radar"
            )
            yield parse.unknown(
                "network-not-yet-open", message, msg(f"wait a minute, or ten at 5600 to 5650 MHz; {arg(hint)}")
            )
        elif network.ssid != self.radio.ssid:
            message = msg(
                f"{arg(name)} has the SSID `{arg(network.ssid)}`; the inventory says `{arg(self.radio.ssid)}`"
            )
            yield parse.fail(
                "other-network", message, "apply the site's configuration, which restores the inventory's settings"
            )
        else:
            yield parse.good("network-open", msg(f"{arg(name)} has the SSID `{arg(network.ssid)}`"))
            if network.frequency_mhz not in {None, self.radio.frequency_mhz}:
                message = msg(
                    f"{arg(name)} is on {arg(network.frequency_mhz)} MHz; the inventory says "
                    f"{arg(self.radio.frequency_mhz)} MHz"
                )
                yield parse.warn(
                    "other-channel", message, "radar may have forced a channel change: choose another channel"
                )

    def _strangers(self, dump: str) -> Iterator[LinkFinding]:
        """Yield findings for stations that are not in the inventory and so have the key."""
        station_names, strangers = (
            self._station_names,
            [mac for mac in read_stations(dump) if mac not in self._station_names],
        )
        if strangers:
            message = msg(
                f"{arg(parse.join_words(strangers))} joined `{arg(self.radio.ssid)}`, but no vehicle of the inventory "
                "has this radio"
            )
            hint = "find its owner: set a new radio in `endpoints.wifi.mac`; otherwise change the `key` of the network"
            yield parse.warn("unknown-station", message, hint)
        names = [station_names[mac] for mac in read_stations(dump) if mac in station_names]
        if names:
            yield parse.good("stations", msg(f"{arg(parse.join_words(names))} joined it"))

    @property
    def _station_names(self) -> Mapping[str, str]:
        """MAC address of each vehicle that is a station, to its name."""
        reserved_macs = {row.name: row.mac for row in self.site.site_config.lan.reservations}
        result = {}
        for key, vehicle in self.site.inventory.vehicles.items():
            wifi = vehicle.endpoints.wifi
            mac = reserved_macs.get(key) if wifi is None or wifi.mac is None else wifi.mac
            if mac is not None and wifi is not None and wifi.role is model.WifiRole.STATION:
                result[mac.upper()] = vehicle.name
        return result
