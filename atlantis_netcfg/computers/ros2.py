"""Part `gateway_ros2`: ROS 2 from the inventory's archive and versions, tested by a talker and a listener.

The archive's signing key comes from the inventory; key and expiry are checked before any gateway is contacted.

A new release of ROS 2 is a row of `RELEASES`. Nothing here is fetched. Sources, read in November 2026:
- systems and ends of life: ros2/ros2_documentation, `Releases.rst`; for a month, its last day is used;
- the live archive and its key: ros-infrastructure/ros-apt-source, `ros-apt-source/debian/rules` and
  `ros-apt-source/keys/ros2-archive-keyring.gpg` (made 2019-05-30, renewed 2025-04-30, good until 2030-06-01);
- the snapshots and their key: osrf/docker_images, `ros/foxy/ubuntu/focal/ros-core/Dockerfile` and issue 697. An archive
  called `final` exists only once a release has ended;
- localhost only: ROS 2 manual, Improved Dynamic Discovery (since Iron).

These archives were not queried: a run on a board shows whether they still have arm64 of focal.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import openpgp
from atlantis_netcfg.computers import parts
from atlantis_netcfg.computers.recording import packages as recorder
from atlantis_netcfg.computers.recording import recording
from atlantis_netcfg.computers.ros1_bridge import packages as bridge
from atlantis_netcfg.computers.ros1_bridge import ros1_bridge
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory


FOLDER = "keys"
"""Folder in the inventory; public keys only."""
_WARN = timedelta(days=60)


@dataclass(frozen=True, slots=True)
class ArchiveKey:
    """A public key in the format of apt."""

    content: bytes
    """Binary key, also if the file was text."""
    fingerprint: str
    note: str | None = None
    """Information for the technician about this key."""


def archive_key(inventory: Path, archive: Archive, key_file: str | None, now: datetime) -> ArchiveKey:
    """Read the inventory's key; the archive's default key must match its known fingerprint. Raises UsageError."""
    name = key_file or archive.key_file
    path = inventory / FOLDER / name
    content = _read(path, archive)
    try:
        keys = openpgp.public_keys(content)
        packets = openpgp.binary(content)
    except openpgp.NotAKey as why:
        raise UsageError(
            f"{arg(FOLDER)}/{arg(name)} of the inventory is not a public key: {arg(why)}", hint=_fetch_hint(archive)
        ) from None
    if len(keys) != 1:
        raise UsageError(
            f"{arg(FOLDER)}/{arg(name)} of the inventory contains {arg(len(keys))} keys, but an archive is signed by "
            "one",
            hint=f"gpg --export --armor {arg(archive.fingerprint)} > {arg(path)}",
        )
    key = keys[0]
    if key_file is None and key.fingerprint != archive.fingerprint:
        raise UsageError(
            f"{arg(FOLDER)}/{arg(name)} of the inventory is a different key: {arg(key.fingerprint)}, not "
            f"{arg(archive.fingerprint)}",
            hint=(
                f"{arg(_fetch_hint(archive))}; if the archive has a new key, ask its maintainer, and set it as "
                "`key_file`"
            ),
        )
    if key.expires is None:
        return ArchiveKey(packets, key.fingerprint)
    expires = datetime.fromtimestamp(key.expires, UTC)
    if now >= expires:
        raise UsageError(
            f"the key of the ROS 2 archive expired on {arg(expires):%Y-%m-%d}: {arg(FOLDER)}/{arg(name)} of the "
            "inventory",
            hint=f"{arg(_fetch_hint(archive))}; the same key is renewed now and then, with a later expiry date",
        )
    text = msg(f"the key of the ROS 2 archive expires on {arg(expires):%Y-%m-%d}: download the renewed one before")
    return ArchiveKey(packets, key.fingerprint, text if now >= expires - _WARN else None)


def _read(path: Path, archive: Archive) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        why = msg("is missing" if isinstance(error, FileNotFoundError) else f"cannot be read: {arg(error.strerror)}")
        raise UsageError(
            f"the key that signs the ROS 2 archive {arg(why)}: {arg(FOLDER)}/{arg(path.name)} of the inventory",
            hint=_fetch_hint(archive),
        ) from error


def _fetch_hint(archive: Archive) -> str:
    return msg(
        f"download it where there is internet: curl -fsSL '{arg(archive.key_url)}' -o "
        f"inventory/{arg(FOLDER)}/{arg(archive.key_file)}; its fingerprint must be {arg(archive.fingerprint)}"
    )


ARCHITECTURES = ("amd64", "arm64")


@dataclass(frozen=True, slots=True)
class Archive:
    """A package archive and its signing key."""

    url: str
    key_file: str
    """File name below `keys` in the inventory."""
    fingerprint: str
    key_url: str
    """Address from which a person can download the key."""


@dataclass(frozen=True, slots=True)
class RosRelease:
    """A release of ROS 2 and its Ubuntu version."""

    name: str
    codename: str
    ends: date
    archives: Mapping[model.RosOrigin, Archive]
    alone: Mapping[str, str]
    """Environment variables that keep a process local to its computer; only for the talker and listener test."""
    ros1: Mapping[model.RosOrigin, str] = field(default_factory=dict)
    """Archives of ROS 1 for that Ubuntu version, signed by the same keys; used where there is a bridge to ROS 1."""


_LIVE = Archive(
    url="http://packages.ros.org/ros2/ubuntu",
    key_file="ros2-archive-keyring.gpg",
    fingerprint="C1CF6E31E6BADE8868B172B4F42ED6FBAB17C654",
    key_url="https://raw.githubusercontent.com/ros/rosdistro/master/ros.key",
)
_SNAPSHOT_KEY = "4B63CF8FDE49746E98FA01DDAD19BAB3CBF125EA"
_FINAL_FOXY = Archive(
    url="http://snapshots.ros.org/foxy/final/ubuntu",
    key_file="ros-snapshots.asc",
    fingerprint=_SNAPSHOT_KEY,
    key_url=f"https://keyserver.ubuntu.com/pks/lookup?op=get&search=0x{_SNAPSHOT_KEY}",
)
_BEFORE_IRON = {"ROS_LOCALHOST_ONLY": "1"}
_SINCE_IRON = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}

RELEASES: Mapping[model.RosDistribution, RosRelease] = {
    model.RosDistribution(release.name): release
    for release in (
        RosRelease(
            "foxy",
            "focal",
            date(2023, 6, 20),
            {model.RosOrigin.LIVE: _LIVE, model.RosOrigin.SNAPSHOT: _FINAL_FOXY},
            _BEFORE_IRON,
            {
                model.RosOrigin.LIVE: "http://packages.ros.org/ros/ubuntu",
                model.RosOrigin.SNAPSHOT: "http://snapshots.ros.org/noetic/final/ubuntu",
            },
        ),
        RosRelease("humble", "jammy", date(2027, 5, 31), {model.RosOrigin.LIVE: _LIVE}, _BEFORE_IRON),
        RosRelease("jazzy", "noble", date(2029, 5, 31), {model.RosOrigin.LIVE: _LIVE}, _SINCE_IRON),
    )
}

_KEYRING = "/usr/share/keyrings/ros2-archive-keyring.gpg"
_SOURCE = "/etc/apt/sources.list.d/ros2.sources"
_SOURCE_ROS1 = "/etc/apt/sources.list.d/ros1.sources"
_SAME_ROS1 = "/etc/apt/sources.list.d/ros-latest.list"
_SAME = ("/etc/apt/sources.list.d/ros2.list", "/etc/apt/sources.list.d/ros2-latest.list")
"""Files from the official ROS instructions. With a different keyring for the same address, apt rejects all sources."""
_PINS = "/etc/apt/preferences.d/atlantis-ros2"
_LOGIN = "/etc/profile.d/atlantis-ros2.sh"
_TEST = "/usr/local/lib/atlantis/ros2_hears.py"
_MESSAGES, _PATIENCE_S = 3, 90
"""Messages expected from the talker (one a second), and seconds to wait: a first start of Python nodes is slow."""
_TEST_DOMAIN = 101
"""ROS domain for the test, used by nothing else."""
_COLCON = "python3-colcon-common-extensions"


@dataclass(frozen=True, slots=True)
class StandIn:
    """An archive of stub packages that replaces the ROS archive in a rehearsal, and its target system."""

    url: str
    key: ArchiveKey
    codename: str
    distribution: str


@dataclass(frozen=True, slots=True)
class GatewayRos2:
    """Desired state that the role installs, writes and tests; empty if the inventory has no ROS 2."""

    packages: tuple[parts.Package, ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)
    """Path to content; ROS 1 is included only if a package of it is needed."""
    pins: str = ""
    key: ArchiveKey | None = None
    codename: str = ""
    distribution: str = ""
    configuration: parts.Configuration = field(default_factory=parts.Configuration)
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters of the role's modules."""
        if self.key is None:
            return {"packages": None, "configure": None}
        key = {
            "path": _KEYRING,
            "content_base64": base64.b64encode(self.key.content).decode(),
            "fingerprint": self.key.fingerprint,
        }
        return {
            "packages": {
                "packages": [{"name": package.name, "version": package.version} for package in self.packages],
                "sources": [{"path": path, "content": content} for path, content in self.sources.items()],
                "keys": [key],
                "pins": [{"path": _PINS, "content": self.pins}],
                "absent": [*_SAME, _SAME_ROS1 if _SOURCE_ROS1 in self.sources else _SOURCE_ROS1],
                "expected": {
                    "codename": self.codename,
                    "distribution": self.distribution,
                    "architectures": list(ARCHITECTURES),
                },
                "notes": list(self.notes),
            },
            "configure": self.configuration.as_dict(),
        }


def gateway_ros2(
    inventory: Inventory, host: Host, stand_in: StandIn | None = None, now: datetime | None = None
) -> GatewayRos2:
    """Build the desired state; reads the archive's key, else pure. Raises UsageError. `now`: current time."""
    assert isinstance(host.device, model.ServerComputer)  # noqa: S101 - callers choose computers with a base of ours
    ros2, dds = inventory.pilot.gateways.ros2, inventory.pilot.dds
    if ros2 is None or not host.device.has_ros2:
        return GatewayRos2()
    if dds is None:
        raise UsageError(
            "`gateways.ros2` is set but `dds` is not: the release of ROS 2 is unknown",
            hint="set `dds` in group_vars/all/pilot.yml, with its `distribution`",
        )
    release = RELEASES[dds.distribution]
    today = now or datetime.now(UTC)
    notes: tuple[str | None, ...] = (_end_of_life_note(release, today),)
    if stand_in is None:
        archive = _archive(release, ros2)
        key, url, codename, system = (
            archive_key(inventory.root, archive, ros2.key_file, today),
            str(ros2.mirror or archive.url),
            release.codename,
            "ubuntu",
        )
    else:
        key, url, codename, system = stand_in.key, stand_in.url, stand_in.codename, stand_in.distribution
        notes = (*notes, msg(f"{arg(host.name)}: stand-ins replace the packages of ROS 2"))
    recording_config = host.device.recording if isinstance(host.device, model.Gateway) else None
    has_bridge_package = host.device.ros1_bridge is not None and host.device.ros1_bridge.archive is None
    more = (
        *(() if recording_config is None else recorder(release.name)),
        *(bridge(release.name) if has_bridge_package else ()),
    )
    packages = tuple(_packages(release, ros2, dds, more))
    urls = {_SOURCE: ("ROS 2", url)}
    if has_bridge_package and stand_in is None:
        urls[_SOURCE_ROS1] = "ROS 1", str(ros2.ros1_mirror or release.ros1[ros2.origin])
    return GatewayRos2(
        packages=packages,
        sources={
            path: _render("ros2.sources.j2", name=name, url=each, codename=codename, keyring=_KEYRING)
            for path, (name, each) in urls.items()
        },
        pins=_render(
            "ros2.pref.j2",
            hosts=dict.fromkeys(urlsplit(each).hostname for _, each in urls.values()),
            origin=ros2.origin.value,
            pins=ros2.pins,
        ),
        key=key,
        codename=codename,
        distribution=system,
        configuration=_configuration(release, dds, packages)
        .merge(recording(recording_config, release.name))
        .merge(ros1_bridge(host.device.ros1_bridge, release.name)),
        notes=tuple(note for note in (*notes, key.note) if note is not None),
    )


def _archive(release: RosRelease, ros2: model.Ros2) -> Archive:
    """Return the archive of the inventory; a mirror of a snapshot is signed by the snapshots' key."""
    archive = release.archives.get(ros2.origin)
    if archive is None and ros2.mirror is not None:
        archive = next(match for row in RELEASES.values() if (match := row.archives.get(ros2.origin)) is not None)
    if archive is None:
        raise UsageError(
            f"there is no final snapshot of {arg(release.name)} yet: its support has not ended",
            hint=(
                "set `origin: live`; or a dated snapshot as `mirror`: "
                f"http://snapshots.ros.org/{arg(release.name)}/2026-01-31/ubuntu, with a date that exists there"
            ),
        )
    return archive


def _end_of_life_note(release: RosRelease, today: datetime) -> str | None:
    if today.date() <= release.ends:
        return None
    return msg(f"ROS 2 {arg(release.name)} has been without security updates since {arg(release.ends):%Y-%m-%d}")


def _packages(release: RosRelease, ros2: model.Ros2, dds: model.Dds, more: tuple[str, ...]) -> Iterator[parts.Package]:
    ros = f"ros-{release.name}"
    names = [f"{ros}-ros-base", f"{ros}-demo-nodes-cpp", f"{ros}-demo-nodes-py", _COLCON]
    if dds.middleware is model.RosMiddleware.CYCLONE_DDS:
        names.append(f"{ros}-rmw-cyclonedds-cpp")
    versions = {pin.package: pin.version for pin in ros2.pins}
    for name in dict.fromkeys((*names, *more, *ros2.packages)):
        yield parts.Package(name, versions.get(name))


def _configuration(release: RosRelease, dds: model.Dds, packages: tuple[parts.Package, ...]) -> parts.Configuration:
    """Return the login environment and the test, which runs again after a change of ROS packages."""
    home = f"/opt/ros/{release.name}"
    variables = {
        **release.alone,
        "ROS_DOMAIN_ID": str(_TEST_DOMAIN),
        "RMW_IMPLEMENTATION": dds.middleware.value,
    }
    test = (
        "/usr/bin/python3",
        _TEST,
        home,
        str(_MESSAGES),
        str(_PATIENCE_S),
        *(f"{name}={value}" for name, value in variables.items()),
    )
    lists = (f"/var/lib/dpkg/info/{package.name}.md5sums" for package in packages)
    return parts.Configuration(
        files=(
            parts.File(_LOGIN, _render("ros2-profile.sh.j2", release=release.name, home=home)),
            parts.File(_TEST, _render("ros2_hears.py")),
        ),
        steps=(parts.ConvergeStep("talker and listener of ROS 2", test, (_TEST, *lists)),),
    )


def _render(template: str, **values: object) -> str:
    return environment().get_template(f"gateway/{template}").render(**values)
