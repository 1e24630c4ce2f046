"""Part `gateway_interop`: the interoperability library with examples, the data gateway as a service, and a test.

systemd starts the service when the VPN interface appears and stops it when the interface goes. A DDS participant that
starts before its interface has an address is never discovered (facts 5.5).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.computers import parts, services
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory

PREFIX = "/opt/atlantis/interop"
SERVICE = "atlantis-data-gateway.service"
USER = "atlantis-interop"

_PACKAGES = ("ca-certificates", "cmake", "git")
"""Packages installed in addition to the declared ones; not listed in the report. colcon comes with ROS 2."""
_TEST_S = 15
_USER = "/usr/lib/sysusers.d/atlantis-interop.conf"
_SETUP_SCRIPT = "/usr/local/lib/atlantis/interop.sh"
_COMMAND = "/usr/local/lib/atlantis/data-gateway"
_UNIT = f"/etc/systemd/system/{SERVICE}"
_LOGS = "/etc/tmpfiles.d/atlantis-interop.conf"
_BUILD_RECORD = f"{PREFIX}/current/build.json"


@dataclass(frozen=True, slots=True)
class GatewayInterop:
    """Desired state of the role; without a library in the inventory, what it removes."""

    packages: tuple[parts.Package, ...] = ()
    build: dict[str, Any] | None = None
    """Parameters of the module `build`, without tokens."""
    configuration: parts.Configuration = field(default_factory=parts.Configuration)
    connection_test: dict[str, Any] | None = None
    """Parameters of the module `connection_test`."""

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters of the role's modules."""
        packages = [{"name": package.name, "version": package.version} for package in self.packages]
        return {
            "packages": {"packages": packages},
            "build": self.build,
            "configure": self.configuration.as_dict(),
            "connection_test": self.connection_test,
        }


def gateway_interop(inventory: Inventory, host: Host) -> GatewayInterop:
    """Build the desired state of a host (pure); a valid inventory has a ROS 2 release where a library is built."""
    assert isinstance(host.device, model.ServerComputer)  # noqa: S101 - callers choose computers with a base of ours
    interop = inventory.pilot.gateways.interop
    dds = inventory.pilot.dds
    if interop is None or dds is None or not host.device.has_interop:
        return GatewayInterop(configuration=_configuration(None, ""))
    ros = f"/opt/ros/{dds.distribution.value}/setup.sh"
    names = dict.fromkeys((*_PACKAGES, *interop.packages))
    return GatewayInterop(
        packages=tuple(parts.Package(name) for name in names),
        build={
            "library": _repository(interop.library),
            "examples": _repository(interop.examples),
            "ros_setup": ros,
            "prefix": PREFIX,
        },
        configuration=_configuration(interop, ros),
        connection_test=_connection_test(interop),
    )


def _repository(repository: model.Repository | None) -> dict[str, str] | None:
    return None if repository is None else {"url": repository.url, "revision": repository.revision}


def _configuration(interop: model.Interop | None, ros: str) -> parts.Configuration:
    files: tuple[parts.File, ...] = ()
    if interop is not None:
        files += (
            parts.File(_USER, f'u {USER} - "ATLANTIS data gateway" /var/lib/{USER}\n'),
            # ROS writes a log for every process, and removes none.
            parts.File(_LOGS, f"d /var/log/{USER} 0750 {USER} {USER} 14d\n"),
            parts.File(_SETUP_SCRIPT, _render("interop.sh.j2", ros=ros), validate=("sh", "-n", "%s")),
        )
    if interop is not None and interop.service is not None:
        command = _render("data-gateway.sh.j2", service=interop.service)
        files += (
            parts.File(_COMMAND, command, mode="0755", validate=("sh", "-n", "%s"), hint=_NO_COMMAND),
            parts.File(_UNIT, _render("data-gateway.service.j2", service=interop.service)),
        )
    file_paths = {file.path for file in files}
    units = (parts.Unit(SERVICE, enabled=True, after=(_UNIT, _COMMAND, _SETUP_SCRIPT, _BUILD_RECORD), wait=False),)
    return parts.Configuration(
        files=files,
        absent=tuple(path for path in (_UNIT, _COMMAND, _SETUP_SCRIPT, _LOGS) if path not in file_paths),
        steps=(
            parts.ConvergeStep("create the account of the data gateway", ("systemd-sysusers", _USER), (_USER,)),
            parts.ConvergeStep(
                "create the logs of the data gateway", ("systemd-tmpfiles", "--create", _LOGS), (_LOGS,)
            ),
            services.vpn_bound_step("start the data gateway with the VPN, or remove it", SERVICE),
        ),
        units=units if _UNIT in file_paths else (),
        checks=_CHECKS if _UNIT in file_paths else (),
    )


_CHECK_CPU_QUOTA = """\
[ -e /sys/fs/cgroup/cpu/cpu.cfs_quota_us ] && exit 0
for bound in /sys/fs/cgroup/*/cpu.max; do
    [ ! -e "$bound" ] || exit 0
done
{ zcat /proc/config.gz || cat "/boot/config-$(uname -r)"; } 2>/dev/null | grep -qx CONFIG_CFS_BANDWIDTH=y
"""
"""Check that `CPUQuota=` is enforced: a file of cgroups v1 or v2; without a group yet, the kernel's build options."""
_CHECKS = (
    parts.Check(
        ("sh", "-c", _CHECK_CPU_QUOTA),
        "`cpu_percent` of the data gateway is not enforced: nothing here shows that the kernel was built with "
        "CONFIG_CFS_BANDWIDTH",
        "use a kernel that has it; until then, watch the load of the data gateway: `systemd-cgtop` on the computer",
    ),
)
_NO_COMMAND = "check `command` of `service:`: a quotation mark may be missing"


def _render(template: str, **values: object) -> str:
    names = {
        "prefix": PREFIX,
        "sourced": _SETUP_SCRIPT,
        "command": _COMMAND,
        "user": USER,
        "environment": services.ENVIRONMENT,
    }
    return environment().get_template(f"gateway/{template}").render(**names, interface=services.VPN_INTERFACE, **values)


def _connection_test(interop: model.Interop) -> dict[str, Any] | None:
    if interop.connection_test is None:
        return None
    examples = f"{PREFIX}/current/examples"
    return {
        "program": f"{examples}/build/{interop.connection_test.program}",
        "config": f"{examples}/{interop.connection_test.config}",
        "sourced": _SETUP_SCRIPT,
        "environment": services.ENVIRONMENT,
        "built": _BUILD_RECORD,
        "user": USER,
        "interface": services.VPN_INTERFACE,
        "seconds": _TEST_S,
    }
