"""Part `gateway_dds`: profiles of a gateway's links, the environment that names one, and who has to read it anew."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.dds import FOLDER, ProfileView, profile_views, profiles
from atlantis_netcfg.gateway.interop import SERVICE
from atlantis_netcfg.render import environment

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.declaration import Declaration, Host

__all__ = ["ENVIRONMENT", "LOGIN", "GatewayDds", "gateway_dds"]

ENVIRONMENT = "/etc/atlantis/ros.env"
"""What services take as their `EnvironmentFile=`."""
LOGIN = "/etc/profile.d/atlantis-rosenv.sh"
"""The same for people who log in; `~/.bashrc` stays theirs.

Its name sorts after that of ROS 2's own set-up, `atlantis-ros2.sh`: since Iron that may narrow the range of discovery.
"""
_READERS = (SERVICE,)
"""Units that read a profile when they start, and keep it. One that does not run is left alone; one that waits for the
VPN is not waited for.
"""
_NARROWS = {"ROS_LOCALHOST_ONLY": "0"}
"""Releases since Iron still obey it where it is set."""


@dataclass(frozen=True, slots=True)
class GatewayDds:
    """What the role lays down. Without declared DDS nothing, and what it once laid down is taken away."""

    in_use: str | None = None
    """The link whose profile the environment names: the slowest of the site, because a process keeps what it read."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Path -> content."""
    alone: Mapping[str, str] = field(default_factory=dict)
    """Variables that nothing else on the computer may set otherwise: that would shut the VPN out, silently."""

    def as_dict(self) -> dict[str, Any]:
        """The parameters of the role's tasks."""
        read = [path for path in self.files if path.startswith(f"{FOLDER}/{self.in_use}/") or path == ENVIRONMENT]
        return {
            "in_use": self.in_use,
            "configure": {
                "files": [{"path": path, "content": content} for path, content in self.files.items()],
                "absent": [path for path in (ENVIRONMENT, LOGIN) if path not in self.files],
                "only": [FOLDER],
                "units": [{"name": name, "after": read or [ENVIRONMENT], "wait": False} for name in _READERS],
            },
            "elsewhere": {"variables": dict(self.alone), "ours": [ENVIRONMENT, LOGIN]},
        }


def gateway_dds(declaration: Declaration, host: Host) -> GatewayDds:
    """Pure. The declaration is valid: a gateway that talks over the VPN has an address in it."""
    if declaration.pilot.dds is None:
        return GatewayDds()
    views = profile_views(declaration, host)
    slowest = _slowest(views)
    files = {f"{FOLDER}/{name}": text for view in views for name, text in profiles(view).items()}
    files[ENVIRONMENT] = files[f"{FOLDER}/{slowest.bearer}/ros.env"]
    files[LOGIN] = environment().get_template("gateway/ros-profile.sh.j2").render(environment=ENVIRONMENT)
    return GatewayDds(slowest.bearer, files, {**_NARROWS, **slowest.release.environment})


def _slowest(views: tuple[ProfileView, ...]) -> ProfileView:
    """Announces itself most rarely; of two alike the one that is less preferred."""
    return max(reversed(views), key=lambda view: view.tuning.announce_s)
