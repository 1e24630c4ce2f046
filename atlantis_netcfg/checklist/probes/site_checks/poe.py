"""The router's PoE ports supply the devices in the inventory, and these draw power."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import PoeMode
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.status import Query

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping


_NAMES = "names"
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_FAULTS: Mapping[str, str] = {
    "short-circuit": "a short circuit: unplug the cable and check the plug for water",
    "short_circuit": "a short circuit: unplug the cable and check the plug for water",
    "overload": "an overload: the device draws more than the port supplies",
    "voltage-too-low": "a low voltage: check the router's own power supply",
    "voltage-too-high": "a high voltage: check the router's own power supply",
    "current-too-low": "a low current, for example from a broken cable",
    "controller-error": "an error of its PoE controller: restart the router",
}
"""Faults as RouterOS reports them (Manual, PoE-Out) -> what they mean."""


def poe_check(site: parse.OwnSite) -> base.Step:
    """Return one step for all PoE ports."""
    ports = _feeding_ports(site)
    unless = "" if ports else "no port of the router supplies power in the inventory"
    fed = tuple(_fed(site).values())
    return parse.step("poe", "Devices are powered by PoE", _PoeCheck(site), (*site.hosts[:1], *fed), unless)


def _feeding_ports(site: parse.OwnSite) -> tuple[str, ...]:
    feeding = (port for port in site.device.ports if port.poe is not None and port.poe.out is not PoeMode.OFF)
    return tuple(port.name for port in feeding)


def _fed(site: parse.OwnSite) -> dict[str, str]:
    """Return, for each port, the device that it powers according to the inventory."""
    result = {}
    for host in site.inventory.site_hosts(site.name):
        source = host.device.powered_by
        if source is not None and site.router is not None and source.device == site.router.name:
            result[source.port] = host.name
    return result


@dataclass(frozen=True, slots=True)
class _PoeCheck:
    """Check that devices are powered by PoE."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        """Request each port separately: a port without PoE would make a joint request fail."""
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        name = self.site.router.name
        names = base.RouterOsQuery(_NAMES, name, Query("/interface/ethernet", "print", (), ("name", "default-name")))
        return (*(self._monitor(name, port) for port in _feeding_ports(self.site)), names)

    @staticmethod
    def _monitor(host: str, port: str) -> base.RouterOsQuery:
        return base.RouterOsQuery(
            port, host, Query("/interface/ethernet/poe", "monitor", (("numbers", port), ("once", "")))
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        name, fed = self.site.router.name, _fed(self.site)
        values = {
            port: parse.rows(results[port], name, "the power on its ports", "name")
            for port in _feeding_ports(self.site)
        }
        silence = [entry for entry in values.values() if isinstance(entry, LinkFinding)]
        if len(silence) == len(values):
            return base.ProbeResult((_board(name, values) or silence[0],))
        names = parse.rows(results[_NAMES], name, "the names of its ports", "default-name")
        if isinstance(names, LinkFinding):
            return base.ProbeResult((names,))
        if rename_findings := tuple(_check_port_names(name, values, names)):
            return base.ProbeResult(rename_findings)
        ports = {port: row for port, port_rows in values.items() if (row := _row_of(port, port_rows)) is not None}
        modes = {item.name: item.poe.out for item in self.site.device.ports if item.poe is not None}
        wrong = [
            finding
            for port in values
            for finding in _judge_port(name, port, fed.get(port), ports.get(port), modes[port])
        ]
        evidence = tuple(
            parse.read(msg(f"PoE on {arg(port)} of {arg(name)}"), _describe_power(row)) for port, row in ports.items()
        )
        return base.ProbeResult(tuple(wrong) or (self._good_finding(ports, fed),), evidence)

    def _good_finding(self, ports: Mapping[str, Mapping[str, str]], fed: Mapping[str, str]) -> LinkFinding:
        draws = [msg(f"{arg(box)} ({arg(_draw(ports[port]))})") for port, box in fed.items() if port in ports]
        if not draws:
            return parse.good(
                "no-fault", "no port that supplies power has a fault; the inventory has no device powered by one"
            )
        return parse.good(
            "powered",
            msg(f"{arg(parse.join_words(draws))} {'draws' if len(draws) == 1 else 'draw'} power from the router"),
        )


def _check_port_names(name: str, ports: Iterable[str], names: Iterable[Mapping[str, str]]) -> Iterator[LinkFinding]:
    """Yield findings for renamed ports, whose readings belong to another socket, or none."""
    name_by_port = {row.get("default-name", ""): row.get("name", "") for row in names}
    for port in ports:
        if name_by_port.get(port, port) != port:
            message = msg(
                f"{arg(port)} of {arg(name)} is named {arg(name_by_port[port])} there, so its power was not reported"
            )
            yield parse.fail("port-renamed", message, "apply the site's configuration, which restores the port names")


def _board(name: str, values: Mapping[str, object]) -> LinkFinding | None:
    """Return a finding if the board has no PoE, and so neither the menu nor the ports."""
    if any(not isinstance(item, LinkFinding) or item.code != "refused" for item in values.values()):
        return None
    message = msg(
        f"{arg(name)} reports no PoE and seems to have none, but in the inventory {arg(parse.join_words(values))} "
        "supply power"
    )
    hint = "compare `poe` of the router's ports with the hardware; without PoE each device needs its own power supply"
    return parse.unknown("no-poe", message, hint)


def _row_of(port: str, result: tuple[Mapping[str, str], ...] | LinkFinding) -> Mapping[str, str] | None:
    return None if isinstance(result, LinkFinding) else next((row for row in result if row.get("name") == port), None)


def _judge_port(
    name: str, port: str, box: str | None, row: Mapping[str, str] | None, mode: PoeMode
) -> Iterator[LinkFinding]:
    where = msg(f"{arg(port)} of {arg(name)}" + (f", which powers {arg(box)}" if box else ""))
    if row is None or "poe-out-status" not in row:
        hint = "compare `poe` of the router's ports with the hardware: not every port or router can supply power"
        yield parse.unknown("port-untold", msg(f"the router does not report the power on {arg(where)}"), hint)
        return
    status = row["poe-out-status"]
    if status in _FAULTS:
        yield parse.fail(
            "poe-fault", msg(f"{arg(where)}, reports {arg(status)}"), msg(f"that is {arg(_FAULTS[status])}")
        )
    elif box is None:
        return
    elif status in {"waiting-for-load", "waiting_for_load"}:
        message = msg(f"no device draws power on {arg(where)}: the port waits for a load")
        yield parse.fail(
            "nobody-draws",
            message,
            msg(f"check that {arg(box)} is connected to {arg(port)}, with a cable that has all eight wires"),
        )
    elif status in {"off", "disabled"}:
        yield parse.fail(
            "poe-off",
            msg(f"the power on {arg(where)}, is switched off"),
            "apply the site's configuration, which switches it on",
        )
    elif status not in {"powered-on", "powered_on"}:
        yield parse.unknown(
            "status-unknown",
            msg(f"{arg(where)}, reports `{arg(status)}`"),
            "look up that status in the router's manual",
        )
    elif _value(row, "poe-out-current") == 0 or _value(row, "poe-out-power") == 0:
        yield parse.warn(
            "draws-nothing",
            msg(f"{arg(where)}, is powered but draws nothing"),
            msg(f"check whether {arg(box)} is also powered from elsewhere"),
        )
    elif mode is PoeMode.FORCED_ON and _value(row, "poe-out-current") is None and _value(row, "poe-out-power") is None:
        message = msg(f"{arg(where)}, is always powered, and the router does not report the power drawn")
        yield parse.unknown("draw-untold", message, msg(f"check the LEDs of {arg(box)}, or set the port to `auto-on`"))


def _value(row: Mapping[str, str], name: str) -> float | None:
    """Parse `2.8W`, `120mA`; None if missing."""
    match = _NUMBER.match(row.get(name, ""))
    return None if match is None else float(match[0])


def _draw(row: Mapping[str, str]) -> str:
    return row.get("poe-out-power") or row.get("poe-out-current") or "value not reported"


def _describe_power(row: Mapping[str, str]) -> str:
    figures = (row.get(f"poe-out-{what}") for what in ("status", "voltage", "current", "power"))
    return join(", ", filter(None, figures))
