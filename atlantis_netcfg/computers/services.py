"""Services of a computer in the inventory: their units, and a check that each listens on its port.

The partner provides the program; we provide the unit, the account, the folder and the limits. The computer's firewall
(`computers.base`) defines who reaches the port, and for partners also the firewall of the VPN server (`vpn.policy`).
The check covers only that the program runs and holds its port, not that it responds correctly.

`StartedService` describes each of our units; units that use DDS run only while the VPN interface is present.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.computers import containers, parts
from atlantis_netcfg.computers.containers import PodmanContainer
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping


LIST = "/etc/atlantis/services"
"""List of declared units, one a line; other units of that name pattern are removed from the computer."""
_UNITS = "/etc/systemd/system"
_ACCOUNTS = "/usr/lib/sysusers.d/atlantis-services.conf"
_FOLDERS = "/etc/tmpfiles.d/atlantis-services.conf"
_PRIVILEGED_PORT = 1024
"""Ports below this one require root (ip(7)): the unit gets only that capability."""

_TAKE_AWAY = f"""\
for path in {_UNITS}/atlantis-service-*.service; do
    [ -e "$path" ] || continue
    unit="${{path##*/}}"
    grep -qsx "$unit" {LIST} && continue
    systemctl --quiet disable --now "$unit" || exit 1
    rm -f "$path" || exit 1
done
systemctl daemon-reload || exit 1
command -v podman > /dev/null || exit 0
for image in $(podman images --noheading 'localhost/atlantis/*' | awk '{{ print $1 ":" $2 }}'); do
    unit="${{image#localhost/atlantis/}}"
    grep -qsx "${{unit%%:*}}.service" {LIST} || podman image rm --force "$image" || exit 1
done
"""
HOLDS_PORT = """\
unit="$1" kind="$2" port="$3" tries=0
while [ "$tries" -lt 30 ]; do
    case "$(systemctl show --property ActiveState --value "$unit")" in active | activating) ;; *) exit 1 ;; esac
    for process in $(ss -H -l -n -p "-$kind" "sport = :$port" | grep -o 'pid=[0-9]*' | cut -d = -f 2); do
        ! grep -qs "/$unit" "/proc/$process/cgroup" || exit 0
    done
    tries=$((tries + 1))
    sleep 0.5
done
exit 1
"""
"""Check that a process of this unit listens on the port, not one of another unit. Startup may take 15 s."""
_RUNS = """\
before="$(systemctl show --property ActiveState,MainPID "$1")"
sleep 1
case "$before" in *ActiveState=active*) ;; *) exit 1 ;; esac
[ "$before" = "$(systemctl show --property ActiveState,MainPID "$1")" ]
"""
"""Check of a service without a port: it is active, and has the same process one second later."""


VPN_INTERFACE = "tun0"
"""Interface of OpenVPN on a gateway."""
ENVIRONMENT = "/etc/atlantis/ros.env"
"""File with ROS domain, middleware and profile, written by the part `gateway_dds`, which restarts its readers."""
PROFILES = "/etc/atlantis/dds"
"""Folder of the DDS profiles, written by the part `gateway_dds`."""
_DEVICE = f"sys-subsystem-net-devices-{VPN_INTERFACE}.device"
_UP_OR_DOWN = f"""\
if [ -e "{_UNITS}/$1" ]; then
    systemctl --quiet is-active {_DEVICE} || exit 0
    exec systemctl --no-block start "$1"
fi
rm -f {_UNITS}/*.wants/"$1"
systemctl daemon-reload
exec systemctl stop "$1"
"""
"""Start a unit if its interface is already up; otherwise systemd starts it with the interface."""
_RUNS_WITH_THE_VPN = f"""\
systemctl --quiet is-active {_DEVICE} || exit 0
tries=0
while [ "$tries" -lt 30 ]; do
    if systemctl --quiet is-active "$1"; then exit 0; fi
    tries=$((tries + 1))
    sleep 0.5
done
exit 1
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StartedService:
    """Values for the unit template."""

    name: str
    """Unit name with its suffix."""
    title: str
    user: str
    folder: str
    """The only folder that the service may write to."""
    command: str
    memory_mb: int | None = None
    restart: str = "always"
    stop_s: int = 20
    ends_itself: bool = False
    """The program stops its own child processes."""
    is_privileged: bool = False
    """The service listens on a privileged port (below 1024)."""
    dds: bool = False
    """The service takes part in DDS over the VPN."""
    container: PodmanContainer | None = None
    """Container to run instead of a program."""

    @property
    def path(self) -> str:
        """Path of the unit file."""
        return f"{_UNITS}/{self.name}"

    def unit(self) -> parts.File:
        """Render the unit file."""
        template = environment().get_template("gateway/service.service.j2")
        return parts.File(self.path, template.render(service=self, interface=VPN_INTERFACE, environment=ENVIRONMENT))


def vpn_bound_step(words: str, service: str) -> parts.ConvergeStep:
    """Return the step that starts a service if its unit exists, else stops it; `service` is the unit's name."""
    return parts.ConvergeStep(words, ("sh", "-c", _UP_OR_DOWN, "sh", service), (f"{_UNITS}/{service}",))


def vpn_bound_check(finding: str, service: str) -> parts.Check:
    """Return the check that the service runs while the VPN interface is present."""
    return parts.Check(("sh", "-c", _RUNS_WITH_THE_VPN, "sh", service), finding, _log_hint(service))


def _log_hint(unit: str) -> str:
    return msg(f"on the computer: `systemctl status {arg(unit)}` and `journalctl -eu {arg(unit)}` show why")


def services(computer: model.ServerComputer, images: Mapping[str, str] | None = None) -> parts.Configuration:
    """Build the configuration of a computer's services (pure); without one, remove it.

    `images` (rehearsal only): name of a service to the SHA-256 of its archive.
    """
    service_by_name = {
        service.name: started_service
        for service in computer.services
        if (started_service := _build_service(service)) is not None
    }
    if computer.ros1_bridge is not None and computer.ros1_bridge.archive is not None:
        service_by_name[model.ROS1_BRIDGE] = _bridge(computer.ros1_bridge, computer.ros1_bridge.archive)
    for name, sha256 in (images or {}).items():
        if (container := service_by_name[name].container) is not None:
            service_by_name[name] = replace(service_by_name[name], container=replace(container, sha256=sha256))
    boxes = [each.container for each in service_by_name.values() if each.container is not None]
    files = tuple(_files(service_by_name.values())) if service_by_name else ()
    file_paths = {file.path for file in files}
    programs = [(each, each.program) for each in computer.services if each.program is not None]
    return parts.Configuration(
        directories=(parts.Directory(containers.IMAGES, mode="0700"),) if boxes else (),
        files=files,
        absent=tuple(path for path in (LIST, _ACCOUNTS, _FOLDERS) if path not in file_paths),
        only=(containers.FOLDER,),
        steps=(
            parts.ConvergeStep(
                "create the accounts of services", parts.run_on(_ACCOUNTS, "systemd-sysusers"), (_ACCOUNTS,)
            ),
            parts.ConvergeStep(
                "create the folders of services",
                parts.run_on(_FOLDERS, "systemd-tmpfiles", "--create"),
                (_FOLDERS,),
            ),
            *(box.step() for box in boxes),
            parts.ConvergeStep("remove services that are not in the inventory", ("sh", "-c", _TAKE_AWAY), (LIST,)),
            *(vpn_bound_step(START_BRIDGE, each.name) for each in service_by_name.values() if each.dds),
        ),
        units=(*(containers.UNITS if boxes else ()), *map(_build_unit, service_by_name.values())),
        brought=tuple(
            parts.UserSuppliedFile(program.path, _missing_program_text(service, program))
            for service, program in programs
        ),
        checks=(
            *(box.check() for box in boxes),
            *(check for service in computer.services if service.workload is not None for check in _checks(service)),
            *(vpn_bound_check(BRIDGE_RUNS_NOT, each.name) for each in service_by_name.values() if each.dds),
        ),
    )


def packages(computer: model.ServerComputer) -> tuple[str, ...]:
    """Return the packages that run containers, if any is needed."""
    has_container = any(service.container is not None for service in computer.services)
    bridge = computer.ros1_bridge
    return containers.PACKAGES if has_container or (bridge is not None and bridge.archive is not None) else ()


def secret_placeholder(service: str, variable: str) -> str:
    """Return the placeholder of a service's secret in a file."""
    return f"@secret {variable} of {service}@"


def secret_placeholders(computer: model.ServerComputer) -> tuple[str, ...]:
    """Return all placeholders of a computer, in inventory order."""
    return tuple(
        secret_placeholder(service.name, variable.name)
        for service in computer.services
        if service.container is not None
        for variable in service.container.environment
        if variable.secret is not None
    )


def _unit_stem(name: str) -> str:
    return f"atlantis-service-{name}"


def _build_service(service: model.HostedService) -> StartedService | None:
    runtime = service.workload
    if runtime is None:
        return None
    user, folder = runtime.user or f"svc-{service.name}", runtime.data or f"/var/lib/svc-{service.name}"
    box: PodmanContainer | None = None
    if isinstance(runtime, model.ServiceContainer):
        box = _container(service, runtime, user, folder)
        command = f"{box.script} run"
    else:
        command = runtime.command
    return StartedService(
        name=f"{_unit_stem(service.name)}.service",
        title=msg(f"service {arg(service.name)}"),
        user=user,
        folder=folder,
        command=command,
        memory_mb=runtime.memory_mb,
        restart=runtime.restart.value,
        ends_itself=box is not None,
        is_privileged=_is_privileged(service),
        container=box,
    )


def _container(service: model.HostedService, config: model.ServiceContainer, user: str, folder: str) -> PodmanContainer:
    variables = tuple(
        (each.name, secret_placeholder(service.name, each.name) if each.value is None else each.value)
        for each in config.environment
    )
    return PodmanContainer(
        name=_unit_stem(service.name),
        service=service.name,
        archive=config.archive,
        sha256=config.sha256.lower(),
        user=user,
        arguments=config.arguments or "",
        volumes=(f"{folder}:{config.data_at}",),
        variables=variables,
        is_privileged=_is_privileged(service),
    )


def _is_privileged(service: model.HostedService) -> bool:
    return service.port is not None and service.port < _PRIVILEGED_PORT


BRIDGE = "atlantis-service-ros1-bridge.service"
"""Unit of the bridge to ROS 1."""
START_BRIDGE = "start the bridge to ROS 1 with the VPN, or remove it"
BRIDGE_RUNS_NOT = "the bridge to ROS 1 is not running, although the VPN interface exists"
_QUEUE = 10
"""Queue length of the bridge, in messages, for each topic in the direction to ROS 1."""
_SCRATCH = "/tmp"  # noqa: S108 - inside the container, where it is its own and in memory
_ALL_TOPICS = "ros2 run ros1_bridge dynamic_bridge --bridge-all-topics"
_DECLARED_TOPICS = "sh -c 'rosparam load {topics} && exec ros2 run ros1_bridge parameter_bridge'"


def bridged_topics(config: model.Ros1Bridge) -> str:
    """Render the ROS master's parameter `topics`, which the bridge reads; empty: all topics."""
    rows = "".join(f"  - {{topic: {each.topic}, type: {each.type}, queue_size: {_QUEUE}}}\n" for each in config.topics)
    return f"topics:\n{rows}" if rows else ""


def _bridge(config: model.Ros1Bridge, archive: str) -> StartedService:
    """Build the bridge between the ROS 1 master and DDS over the VPN, with the usual DDS profile."""
    user, stem = f"svc-{model.ROS1_BRIDGE}", _unit_stem(model.ROS1_BRIDGE)
    topics = f"{containers.FOLDER}/{stem}.yaml"
    box = PodmanContainer(
        name=stem,
        service=model.ROS1_BRIDGE,
        archive=archive,
        sha256=(config.sha256 or "").lower(),
        user=user,
        arguments=msg(_DECLARED_TOPICS.format(topics=arg(topics))) if config.topics else _ALL_TOPICS,
        volumes=(f"{PROFILES}:{PROFILES}:ro", *((f"{topics}:{topics}:ro",) if config.topics else ())),
        variables=(("ROS_MASTER_URI", config.master_uri), ("HOME", _SCRATCH), ("ROS_LOG_DIR", f"{_SCRATCH}/log")),
        env_files=(ENVIRONMENT,),
        topics=bridged_topics(config),
        master=config.master,
    )
    return StartedService(
        name=f"{stem}.service",
        title="bridge to ROS 1",
        user=user,
        folder=f"/var/lib/{user}",
        command=f"{box.script} run",
        memory_mb=config.memory_mb,
        ends_itself=True,
        dds=True,
        container=box,
    )


def _files(all_services: Iterable[StartedService]) -> Iterator[parts.File]:
    each_one = tuple(all_services)
    accounts = {each.user: f'u {each.user} - "ATLANTIS service" {each.folder}\n' for each in each_one}
    yield parts.File(_ACCOUNTS, "".join(accounts.values()))
    yield parts.File(_FOLDERS, "".join(f"d {each.folder} 0750 {each.user} {each.user} -\n" for each in each_one))
    yield parts.File(LIST, "".join(f"{each.name}\n" for each in each_one))
    for each in each_one:
        yield each.unit()
        if each.container is not None:
            yield from each.container.files()


def _build_unit(service: StartedService) -> parts.Unit:
    """Build the unit; a unit bound to the VPN interface is started by that interface."""
    box = service.container
    after = (service.path, *(file.path for file in (box.files() if box is not None else ())))
    return parts.Unit(service.name, enabled=True, active=None if service.dds else True, after=after, wait=False)


def _missing_program_text(service: model.HostedService, program: model.ServiceProgram) -> str:
    return msg(
        f"{arg(program.path)} of the service `{arg(service.name)}` is missing: the service starts once its partner has "
        "supplied it"
    )


def _checks(service: model.HostedService) -> Iterator[parts.Check]:
    unit = f"{_unit_stem(service.name)}.service"
    if service.port is None:
        finding = msg(f"the service `{arg(service.name)}` does not keep running")
        yield parts.Check(("sh", "-c", _RUNS, "sh", unit), finding, _log_hint(unit))
    else:
        kind = "t" if service.transport.value == "tcp" else "u"
        yield parts.Check(
            ("sh", "-c", HOLDS_PORT, "sh", unit, kind, str(service.port)),
            msg(
                f"the service `{arg(service.name)}` does not listen on {arg(service.transport)} port "
                f"{arg(service.port)}"
            ),
            _log_hint(unit),
        )
    if service.container is not None:
        folder = service.container.data or f"/var/lib/svc-{service.name}"
        yield containers.folder_budget_check(service.name, folder, service.container.budget_mb)
