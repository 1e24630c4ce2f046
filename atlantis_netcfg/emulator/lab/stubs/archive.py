"""A signed archive of stub packages, laid out like those of Debian and Ubuntu, with its own key.

The ROS 2 stubs are complete enough for a talker and a listener that exchange messages over the loopback.

Stub Debian packages have the name of the original, and say in their description that they are stubs.
"""

from __future__ import annotations

import gzip
import hashlib
import shutil
import subprocess
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core import temporary
from atlantis_netcfg.emulator.lab.hosts import MachineError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence


__all__ = [
    "NOT_REHEARSED",
    "StubArchive",
    "StubError",
    "publish",
    "ros_packages",
    "service_program",
    "why_no_archive",
]


class StubError(MachineError):
    """A stub could not be made."""


@dataclass(frozen=True, slots=True)
class StubPackage:
    """A stub package. `files`: absolute path to text; files below a `bin` or `lib` folder are programs."""

    name: str
    version: str
    depends: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    postinst: str | None = None
    """Shell script that runs when the package is configured; None: there is none."""
    padding_kb: int = 0
    """Size in kB of incompressible padding, for packages that must be large."""
    architecture: str = "all"

    @property
    def file(self) -> str:
        """File name of the package."""
        return f"{self.name}_{self.version}_{self.architecture}.deb"

    @property
    def control(self) -> str:
        """Its control file (Debian Policy 5.3)."""
        size = self.padding_kb + sum(len(text) for text in self.files.values()) // 1024 + 1
        depends = f"Depends: {', '.join(self.depends)}\n" if self.depends else ""
        return (
            f"Package: {self.name}\nVersion: {self.version}\nArchitecture: {self.architecture}\n"
            f"Maintainer: ATLANTIS rehearsal <rehearsal@example.org>\nSection: misc\nPriority: optional\n"
            f"Installed-Size: {size}\n{depends}"
            f"Description: stand-in, not {self.name}\n"
            " Made for rehearsals and tests of the ATLANTIS toolkit. It does nothing for a robot.\n"
        )


def build(package: StubPackage, folder: Path) -> Path:
    """Build the .deb in `folder`. Raises StubError."""
    result = folder / package.file
    with temporary.folder("stand-in") as root:
        root.chmod(0o755)
        sums = [_put(root, path, text.encode()) for path, text in package.files.items()]
        if package.padding_kb:
            noise = hashlib.shake_256(package.name.encode()).digest(package.padding_kb * 1024)
            sums.append(_put(root, f"/usr/share/{package.name}/padding", noise))
        meta = root / "DEBIAN"
        meta.mkdir(mode=0o755)
        (meta / "control").write_text(package.control, encoding="utf-8")
        (meta / "md5sums").write_text("".join(sums), encoding="utf-8")
        if package.postinst is not None:
            script = meta / "postinst"
            script.write_text(f"#!/bin/sh\nset -e\n{package.postinst}\n", encoding="utf-8")
            script.chmod(0o755)
        words = ["dpkg-deb", "--root-owner-group", "-Zgzip", "--build", str(root), str(result)]
        process = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - of the system
    if process.returncode:
        raise StubError(f"the stand-in package {package.name} could not be made: {process.stderr.strip()}")
    return result


def _put(root: Path, path: str, content: bytes) -> str:
    """Write a file; return its md5sums line (deb-md5sums(5))."""
    place = root / path.lstrip("/")
    place.parent.mkdir(parents=True, exist_ok=True, mode=0o755)
    place.write_bytes(content)
    place.chmod(0o755 if {"bin", "lib"} & set(place.relative_to(root).parts) else 0o644)
    return f"{hashlib.md5(content, usedforsecurity=False).hexdigest()}  {path.lstrip('/')}\n"


_PROGRAMS = ("dpkg-deb", "gpg", "gpgconf")
_OWNER = "ATLANTIS stand-in archive, not ROS <rehearsal@example.org>"
_YEAR = timedelta(days=365)
_TIME = "%Y%m%dT%H%M%S"
"""Time format of gpg, in UTC."""
_KEY_IS_OLDER = timedelta(hours=1)
"""Age of the key relative to its signatures: gpg rejects a key from the future, even by one second."""


@dataclass(frozen=True, slots=True)
class StubArchive:
    """A folder to serve by HTTP, and its public signing key."""

    folder: Path
    codename: str
    key: bytes
    """Public key, binary."""
    fingerprint: str


def why_no_archive() -> str | None:
    """Return why no archive can be made here, or None."""
    missing = [program for program in _PROGRAMS if shutil.which(program) is None]
    return f"not on this computer: {', '.join(missing)} (packages dpkg, gnupg)" if missing else None


def publish(  # noqa: PLR0913 - what can be wrong with an archive, each in a test
    folder: Path,
    packages: Sequence[StubPackage],
    *,
    codename: str,
    architectures: Sequence[str] = ("amd64", "arm64"),
    signed_at: datetime | None = None,
    expires: datetime | None = None,
) -> StubArchive:
    """Build the packages and sign the archive, all below `folder`. Raises StubError.

    `signed_at`: date of the signature, by default now; the key is an hour older. `expires`: of the key, by default a
    year later.
    """
    if why := why_no_archive():
        raise StubError(f"no archive of stand-ins can be made: {why}", hint="sudo apt-get install dpkg gnupg")
    pool = folder / "pool" / "main"
    pool.mkdir(parents=True)
    entries = [(package, _entry(build(package, pool), package)) for package in packages]
    dist = folder / "dists" / codename
    sums = []
    for architecture in architectures:
        stanzas = "\n".join(text for package, text in entries if package.architecture in ("all", architecture))
        name = f"main/binary-{architecture}/Packages"
        for path, content in ((name, stanzas.encode()), (f"{name}.gz", gzip.compress(stanzas.encode(), mtime=0))):
            (dist / path).parent.mkdir(parents=True, exist_ok=True)
            (dist / path).write_bytes(content)
            sums.append(f" {hashlib.sha256(content).hexdigest()} {len(content)} {path}")
    sign_time = signed_at or datetime.now(UTC)
    release = (
        f"Origin: ATLANTIS stand-ins\nLabel: ATLANTIS stand-ins, not ROS\nSuite: {codename}\nCodename: {codename}\n"
        f"Date: {format_datetime(sign_time, usegmt=True)}\nArchitectures: {' '.join(architectures)}\n"
        "Components: main\nDescription: stand-ins for rehearsals and tests\nSHA256:\n" + "\n".join(sums) + "\n"
    )
    (dist / "Release").write_text(release, encoding="utf-8")
    key, fingerprint = _sign(dist, sign_time, expires or sign_time + _YEAR)
    return StubArchive(folder, codename, key, fingerprint)


def _entry(deb: Path, package: StubPackage) -> str:
    """Return the package's stanza of `Packages`."""
    content = deb.read_bytes()
    head = package.control.rstrip("\n")
    digest = hashlib.sha256(content).hexdigest()
    return f"{head}\nFilename: pool/main/{deb.name}\nSize: {len(content)}\nSHA256: {digest}\n"


def _sign(dist: Path, signed_at: datetime, expires: datetime) -> tuple[bytes, str]:
    """Make a key that ends at `expires`, and sign as of `signed_at`; return key and fingerprint.

    gpg's frozen clock (`!`) runs nevertheless if it is set to the second in which gpg starts: such a key may be a
    second or more younger than requested. So the key is made as if it were an hour earlier.
    """
    # The path of gpg's sockets may have 108 characters: none below a folder of the caller.
    with temporary.folder("gpg", Path("/tmp")) as home:  # noqa: S108 - it is private
        gpg = ["gpg", "--homedir", str(home), "--batch", "--quiet", "--passphrase", "", "--pinentry-mode", "loopback"]
        try:
            key_time = _at(signed_at - _KEY_IS_OLDER)
            _run(*gpg, key_time, "--quick-generate-key", _OWNER, "ed25519", "sign", expires.strftime(_TIME))
            inrelease = str(dist / "InRelease")
            _run(*gpg, _at(signed_at), "--clearsign", "--output", inrelease, str(dist / "Release"))
            key = _run(*gpg, _at(signed_at), "--export")
            listing = _run(*gpg, _at(signed_at), "--list-keys", "--with-colons").decode()
        finally:
            _run("gpgconf", "--homedir", str(home), "--kill", "all")
    return key, next(line.split(":")[9] for line in listing.splitlines() if line.startswith("fpr:"))


def _at(moment: datetime) -> str:
    """Return gpg's option for a fixed time."""
    return f"--faked-system-time={moment.strftime(_TIME)}!"


def _run(*words: str) -> bytes:
    result = subprocess.run(words, capture_output=True, check=False)  # noqa: S603 - of the system, with words of ours
    if result.returncode:
        raise StubError(f"{words[0]} could not sign the stand-ins: {result.stderr.decode(errors='replace').strip()}")
    return result.stdout


NOT_REHEARSED = (
    "ROS 2: the installed packages have its names but are not ROS; talker and listener use UDP, not DDS",
    "ROS 2 recordings: the recorded data are noise",
    "the ROS archive: a signed archive of placeholder packages with its own key replaces it",
)
"""Limits of a rehearsal with stub packages; printed in the rehearsal's report."""

_SOURCES = Path(__file__).parent / "programs"
"""Sources of packaged programs: not modules of this toolkit, and run with the gateway's own Python version."""
_SETUP = """\
# stand-in, not ROS
export ROS_DISTRO={distribution} ROS_VERSION=2 AMENT_PREFIX_PATH={home}
PATH={home}/bin:$PATH
"""


def _source(name: str) -> str:
    return "#!/usr/bin/python3\n" + (_SOURCES / f"{name}.py").read_text(encoding="utf-8")


def service_program(kind: str, port: int) -> str:
    """Return a stub program for a service, listening on its port; `kind` is tcp or udp, port 0 is none."""
    return _source("service") + f"\n\nserve({kind!r}, {port})\n"


def ros_packages(
    distribution: str, version: str = "0.9.2-1stand.in", more: Iterable[str] = ()
) -> tuple[StubPackage, ...]:
    """Return the stub packages of a release such as foxy; `more`: further packages of the inventory."""
    home = f"/opt/ros/{distribution}"
    setup = _SETUP.format(home=home, distribution=distribution)

    def program(name: str) -> str:
        return _source(name).replace("@HOME@", home)

    ros = f"ros-{distribution}"
    packages = (
        StubPackage(f"{ros}-ros-core", version, ("python3",), {f"{home}/bin/ros2": program("ros2")}),
        StubPackage(
            f"{ros}-ros-base",
            version,
            (f"{ros}-ros-core",),
            {f"{home}/setup.sh": setup, f"{home}/setup.bash": f". {home}/setup.sh\n"},
        ),
        StubPackage(
            f"{ros}-demo-nodes-cpp",
            version,
            (f"{ros}-ros-core",),
            {f"{home}/lib/demo_nodes_cpp/talker": program("talker")},
        ),
        StubPackage(
            f"{ros}-demo-nodes-py",
            version,
            (f"{ros}-ros-core",),
            {f"{home}/lib/demo_nodes_py/listener": program("listener")},
        ),
        StubPackage("python3-colcon-common-extensions", version, ("colcon",)),
        StubPackage("ros-noetic-ros-comm", version, (), {"/opt/ros/noetic/setup.sh": "# stand-in, not ROS\n"}),
    )
    names = {package.name for package in packages}
    others = dict.fromkeys((f"{ros}-rmw-cyclonedds-cpp", *more))
    return (*packages, *(StubPackage(name, version) for name in others if name not in names))
