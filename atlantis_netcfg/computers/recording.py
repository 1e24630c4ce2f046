"""The declared recording of a gateway: topics of ROS 2 as bags of rosbag2, in a folder that keeps within its budget.

The service lives as long as the VPN's interface, as the data gateway does. The packages' names are those of the
archives of ROS 2; no package of ROS was to be had here, so the real recorder has not been run by us.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.computers import parts, services
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory.model import Recording

SERVICE = "atlantis-recording.service"
USER = "svc-recording"
_PROGRAM = "/usr/local/lib/atlantis/recording.py"
_ACCOUNT = "/usr/lib/sysusers.d/atlantis-recording.conf"
_FOLDER = "/etc/tmpfiles.d/atlantis-recording.conf"
_UNIT = f"/etc/systemd/system/{SERVICE}"
_NOT_RUNNING = "the recording does not run, though the VPN's interface is there"
_CLOSE_S = 30
"""The recorder closes its bag."""


def packages(release: str) -> tuple[str, ...]:
    """What records; `ros-base` has it since Humble, and Foxy's has not."""
    return tuple(
        f"ros-{release}-{name}" for name in ("ros2bag", "rosbag2-transport", "rosbag2-storage-default-plugins")
    )


def recording(config: Recording | None, release: str) -> parts.Configuration:
    """Pure. None: what is taken away."""
    files = tuple(_files(config, release)) if config is not None else ()
    file_paths = {file.path for file in files}
    return parts.Configuration(
        files=files,
        absent=tuple(path for path in (_UNIT, _PROGRAM, _ACCOUNT, _FOLDER) if path not in file_paths),
        steps=(
            parts.ConvergeStep("make the recording's account", parts.run_on(_ACCOUNT, "systemd-sysusers"), (_ACCOUNT,)),
            parts.ConvergeStep(
                "make the recording's folder", parts.run_on(_FOLDER, "systemd-tmpfiles", "--create"), (_FOLDER,)
            ),
            services.with_the_vpn("start the recording with the VPN, or take it away", SERVICE),
        ),
        units=(parts.Unit(SERVICE, enabled=True, after=(_UNIT, _PROGRAM), wait=False),) if files else (),
        checks=(services.runs_with_the_vpn(_NOT_RUNNING, SERVICE),) if files else (),
    )


def _files(config: Recording, release: str) -> tuple[parts.File, ...]:
    words = (f"/opt/ros/{release}/setup.sh", config.folder, str(config.budget_mb), *config.topics)
    service = services.StartedService(
        name=SERVICE,
        title="recording",
        user=USER,
        folder=config.folder,
        command=f"/usr/bin/python3 {_PROGRAM} {' '.join(words)}",
        stop_s=_CLOSE_S,
        ends_itself=True,
        dds=True,
    )
    return (
        parts.File(_ACCOUNT, f'u {USER} - "ATLANTIS recording" {config.folder}\n'),
        parts.File(_FOLDER, f"d {config.folder} 0750 {USER} {USER} -\n"),
        parts.File(_PROGRAM, environment().get_template("gateway/recording.py").render()),
        service.unit(),
    )
