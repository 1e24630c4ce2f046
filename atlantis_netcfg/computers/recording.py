"""Recording on a gateway: ROS 2 topics as rosbag2 bags, in a folder limited by a budget.

The service runs while the VPN interface is present, like the data gateway. Package names are those of the ROS 2
archives; no ROS package was available, so that we have not run the real recorder.
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
_NOT_RUNNING = "the recording is not running, although the VPN interface exists"
_CLOSE_S = 30
"""Seconds for the recorder to close its bag when it is stopped."""


def packages(release: str) -> tuple[str, ...]:
    """Return the recorder's packages; `ros-base` includes them since Humble, but not in Foxy."""
    return tuple(
        f"ros-{release}-{name}" for name in ("ros2bag", "rosbag2-transport", "rosbag2-storage-default-plugins")
    )


def recording(config: Recording | None, release: str) -> parts.Configuration:
    """Build the recording's configuration (pure); None: remove it."""
    files = tuple(_files(config, release)) if config is not None else ()
    file_paths = {file.path for file in files}
    return parts.Configuration(
        files=files,
        absent=tuple(path for path in (_UNIT, _PROGRAM, _ACCOUNT, _FOLDER) if path not in file_paths),
        steps=(
            parts.ConvergeStep(
                "create the account of the recording", parts.run_on(_ACCOUNT, "systemd-sysusers"), (_ACCOUNT,)
            ),
            parts.ConvergeStep(
                "create the folder of the recording", parts.run_on(_FOLDER, "systemd-tmpfiles", "--create"), (_FOLDER,)
            ),
            services.vpn_bound_step("start the recording with the VPN, or remove it", SERVICE),
        ),
        units=(parts.Unit(SERVICE, enabled=True, after=(_UNIT, _PROGRAM), wait=False),) if files else (),
        checks=(services.vpn_bound_check(_NOT_RUNNING, SERVICE),) if files else (),
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
