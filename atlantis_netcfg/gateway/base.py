"""Part `gateway_base`: what every gateway computer has, whatever runs on it.

Locale, name, time that does not need the VPN, SSH by key only, a firewall that never shuts out who loads it, a journal
that does not fill the card, the watchdog. Chapters 3, 9 and 11 of the facts; Debian 12, Ubuntu 20.04 to 24.04.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.gateway import _steps
from atlantis_netcfg.gateway._view import BaseView, base_view
from atlantis_netcfg.gateway.network import GatewayNetwork, gateway_network
from atlantis_netcfg.gateway.parts import Configuration, File, Link, Package, Unit, WayIn
from atlantis_netcfg.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration import Declaration, Host

__all__ = ["GatewayBase", "gateway_base"]

PACKAGES = ("chrony", "fake-hwclock", "iputils-ping", "iw", "locales", "nftables", "openssh-server", "tzdata")
"""fake-hwclock keeps the time over a power cut on boards whose clock has no battery; elsewhere it does nothing.

iputils-ping and iw are what the pre-test checklist asks a gateway's radios and cables with.
"""
LOCALE = "en_US.UTF-8"
"""The report's (4.6.2): ROS 2 wants one of UTF-8."""

_CHRONY = "/etc/chrony/chrony.conf"
_FIREWALL = "/etc/nftables.conf"
_GPS = "/etc/default/gpsd"
_JOURNAL = "/etc/systemd/journald.conf.d/atlantis.conf"


@dataclass(frozen=True, slots=True)
class GatewayBase:
    """What the role installs and configures."""

    packages: tuple[Package, ...]
    configuration: Configuration
    network: GatewayNetwork | None
    """None: it stays as the image has it."""

    def as_dict(self) -> dict[str, Any]:
        """The parameters of its modules."""
        packages = [{"name": package.name, "version": package.version} for package in self.packages]
        values = {"packages": {"packages": packages}, "configure": self.configuration.as_dict()}
        return values if self.network is None else {**values, "network": self.network.as_dict()}


def gateway_base(declaration: Declaration, host: Host) -> GatewayBase:
    """Pure."""
    view = base_view(declaration, host)
    return GatewayBase(
        packages=tuple(Package(name) for name in (*PACKAGES, *(("gpsd",) if view.gps is not None else ()))),
        configuration=Configuration(
            files=tuple(_files(view)),
            links=(Link("/etc/localtime", f"/usr/share/zoneinfo/{view.time_zone}"),),
            absent=(_steps.CLOUD_INIT_ON, *(() if view.watchdog_s is not None else (_steps.WATCHDOG,))),
            steps=_steps.STEPS,
            units=tuple(_units(view)),
            checks=_steps.CHECKS,
            way_in=WayIn(admit=view.ssh_from, port=view.ssh_port, key=True, hint=_hint(view)),
        ),
        network=gateway_network(declaration, host),
    )


def _files(view: BaseView) -> Iterator[File]:
    yield from (
        File(_steps.LOCALES, f"{LOCALE} UTF-8\n"),
        File("/etc/default/locale", f"LANG={LOCALE}\n"),
        File(_steps.HOSTNAME, f"{view.name}\n"),
        _file(view, "/etc/hosts", "hosts.j2"),
        File("/etc/timezone", f"{view.time_zone}\n"),
        _file(view, _CHRONY, "chrony.conf.j2", _steps.ACCEPT_CHRONY),
        _file(view, _steps.SSHD, "sshd.conf.j2", ("sshd", "-t", "-f", "%s")),
        _file(view, "/etc/apt/apt.conf.d/90atlantis", "apt.conf.j2", ("apt-config", "-c", "%s", "dump")),
        _file(view, _JOURNAL, "journald.conf.j2"),
        _file(view, _steps.SYSCTL, "sysctl.conf.j2"),
        File(_steps.CLOUD_INIT, "# atlantis: name, address and accounts are those of the declaration.\n"),
        File(
            _FIREWALL,
            _text(view, "nftables.conf.j2"),
            validate=("nft", "-c", "-f", "%s"),
            hint=_NO_FIREWALL,
            finding="the declared firewall is not in force",
        ),
    )
    if view.watchdog_s is not None:
        yield _file(view, _steps.WATCHDOG, "watchdog.conf.j2")
    if view.gps is not None:
        yield _file(view, _GPS, "gpsd.j2")


_NO_FIREWALL = (
    "where its words are `Operation not supported`, the kernel of this computer was built without nf_tables: "
    "`nft list ruleset` shows it. Take a newer image of the vendor"
)


def _file(view: BaseView, path: str, template: str, validate: tuple[str, ...] = ()) -> File:
    return File(path, _text(view, template), validate=validate)


def _text(view: BaseView, template: str) -> str:
    return environment().get_template(f"gateway/{template}").render(base=view)


def _units(view: BaseView) -> Iterator[Unit]:
    yield from (
        Unit("systemd-journald.service", after=(_JOURNAL,)),
        Unit("systemd-timesyncd.service", enabled=False, active=False),
        Unit("chrony.service", enabled=True, active=True, after=(_CHRONY,)),
        Unit("nftables.service", enabled=True, active=True, after=(_FIREWALL,), reload=True),
        Unit("ssh.service", after=(_steps.SSHD,), reload=True),
    )
    if view.gps is not None:
        yield Unit("gpsd.service", enabled=True, active=True, after=(_GPS,))


def _hint(view: BaseView) -> str:
    return (
        f"add the network of your computer to `site.management.admit` in group_vars/{view.site}.yml, "
        f"or work from the LAN of the site ({view.lan})"
    )
