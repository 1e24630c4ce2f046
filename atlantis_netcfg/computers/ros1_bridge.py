"""The ROS 1 bridge as a package, for Ubuntu 20.04: Foxy's archive has it, and there is no podman.

ROS 1 is Noetic, the release of that Ubuntu. The names of packages and archives are those of osrf/docker_images,
`ros/foxy/ubuntu/focal/ros1-bridge/Dockerfile`. Neither archive was queried, and we have not run the real bridge;
`services` has the bridge in a container.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.computers import parts, services
from atlantis_netcfg.inventory.model import ROS1_BRIDGE
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory.model import Ros1Bridge

SERVICE = f"atlantis-{ROS1_BRIDGE}.service"
"""Unit name outside the pattern of declared services, because another part removes undeclared ones."""
ROS1 = "noetic"
_USER = f"svc-{ROS1_BRIDGE}"
_HOME = f"/var/lib/{_USER}"
_PROGRAM = "/usr/local/lib/atlantis/ros1_bridge.sh"
_TOPICS = "/etc/atlantis/ros1-bridge.yaml"
_ACCOUNT = f"/usr/lib/sysusers.d/atlantis-{ROS1_BRIDGE}.conf"
_FOLDER = f"/etc/tmpfiles.d/atlantis-{ROS1_BRIDGE}.conf"
_UNIT = f"/etc/systemd/system/{SERVICE}"


def packages(release: str) -> tuple[str, ...]:
    """Return the packages: the bridge, and of ROS 1 the set-up files and `rosparam`."""
    return f"ros-{release}-ros1-bridge", f"ros-{ROS1}-ros-comm"


def ros1_bridge(config: Ros1Bridge | None, release: str) -> parts.Configuration:
    """Build the bridge's configuration (pure); None or a container: remove it."""
    files = tuple(_files(config, release)) if config is not None and config.archive is None else ()
    file_paths = {file.path for file in files}
    return parts.Configuration(
        files=files,
        absent=tuple(path for path in (_UNIT, _PROGRAM, _TOPICS, _ACCOUNT, _FOLDER) if path not in file_paths),
        steps=(
            parts.ConvergeStep(
                "create the account of the bridge", parts.run_on(_ACCOUNT, "systemd-sysusers"), (_ACCOUNT,)
            ),
            parts.ConvergeStep(
                "create the folder of the bridge", parts.run_on(_FOLDER, "systemd-tmpfiles", "--create"), (_FOLDER,)
            ),
            services.vpn_bound_step(services.START_BRIDGE, SERVICE),
        ),
        units=(parts.Unit(SERVICE, enabled=True, after=(_UNIT, _PROGRAM, _TOPICS), wait=False),) if files else (),
        checks=(services.vpn_bound_check(services.BRIDGE_RUNS_NOT, SERVICE),) if files else (),
    )


def _files(config: Ros1Bridge, release: str) -> tuple[parts.File, ...]:
    service = services.StartedService(
        name=SERVICE,
        title="bridge to ROS 1",
        user=_USER,
        folder=_HOME,
        command=f"/bin/sh {_PROGRAM}",
        memory_mb=config.memory_mb,
        dds=True,
    )
    template = environment().get_template("gateway/ros1_bridge.sh.j2")
    topics = _TOPICS if config.topics else ""
    program = template.render(bridge=config, ros1=f"/opt/ros/{ROS1}", ros2=f"/opt/ros/{release}", topics=topics)
    return (
        parts.File(_ACCOUNT, f'u {_USER} - "ATLANTIS bridge to ROS 1" {_HOME}\n'),
        parts.File(_FOLDER, f"d {_HOME} 0750 {_USER} {_USER} -\n"),
        parts.File(_PROGRAM, program, validate=("sh", "-n", "%s")),
        *((parts.File(_TOPICS, services.bridged_topics(config)),) if topics else ()),
        service.unit(),
    )
