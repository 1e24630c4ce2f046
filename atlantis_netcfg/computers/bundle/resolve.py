"""Resolve and fetch missing packages with an isolated apt(8), for any architecture, without root.

From this computer's apt only the programs and the proxy are used: no sources, keys, lists or settings. The
distributions' own archives are one row a distribution.

The index is a flat repository (sources.list(5): `deb file:/folder ./`), one a host, so that a board sees exactly the
packages that were resolved for it.
"""

from __future__ import annotations

import hashlib
import lzma
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING
from urllib.parse import unquote

from atlantis_netcfg.computers.bundle import manifest
from atlantis_netcfg.computers.bundle.requirements import (
    BundleError,
    PackageSource,
    RequirementKey,
    join_errors,
    paragraphs,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from atlantis_netcfg.computers.bundle.requirements import BundleTarget, HostRequirements, PackageRequirement

_URI = re.compile(r"'(?P<uri>[^']+)' (?P<name>\S+) (?P<size>\d+) SHA256:(?P<sha256>[0-9a-f]{64})")
_STATUS = re.compile(r"dlstatus:\d+:(?P<share>[0-9.]+):")


@dataclass(frozen=True, slots=True)
class DebFile:
    """A package file to fetch."""

    name: str
    """File name in apt's folder of archives."""
    size: int
    sha256: str
    uri: str


@dataclass(frozen=True, slots=True)
class Root:
    """The isolated apt of one target; `lists` and `archives` may be shared between targets."""

    folder: Path
    lists: Path
    archives: Path

    @classmethod
    def make(cls, folder: Path, shared_folder: Path, target: BundleTarget, request: HostRequirements) -> Root:
        """Recreate the folder for the requested sources; `shared_folder` caches downloads."""
        if re.search(r"[\s\"';]", str(folder)):
            raise BundleError(f"no work can be done in {folder}", hint="to=FOLDER: a folder without blanks in its name")
        shutil.rmtree(folder, ignore_errors=True)
        root = cls(folder, shared_folder / "lists", shared_folder / "archives")
        etc = folder / "etc" / "apt"
        inside = [etc / f"{name}.d" for name in ("sources.list", "preferences", "apt.conf", "trusted.gpg", "auth.conf")]
        for each in (*inside, root.lists / "partial", root.archives / "partial", folder / "state", folder / "cache"):
            each.mkdir(parents=True, exist_ok=True)
        (folder / "status").write_bytes(target.status)
        new_paths = {key.path: f"{folder}/keys{key.path}" for key in request.keys}
        for key in request.keys:
            place = folder / "keys" / key.path.lstrip("/")
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(key.content)
        for number, source in enumerate(request.sources):
            suffix = ".sources" if source.path.endswith(".sources") else ".list"
            text = re.sub(r"/[^\s\],]+", lambda match: new_paths.get(match[0], match[0]), source.content)
            text = re.sub(r"\bfile:(?=/)", "copy:", text)  # of file: nothing would be put into the folder of archives
            (etc / "sources.list.d" / f"{number:03}{suffix}").write_text(text, encoding="utf-8")
        for number, pin in enumerate(request.pins):
            (etc / "preferences.d" / f"{number:03}.pref").write_text(pin.content, encoding="utf-8")
        (folder / "apt.conf").write_text(_settings(root, target) + _proxies(), encoding="utf-8")
        return root

    def update(self) -> None:
        """Fetch the package lists. Raises BundleError with apt's messages."""
        process = self._apt("update", "-o", "APT::Update::Error-Mode=any")
        complaints = _marked_messages(process, "E:", "W:", "Err:")
        # apt-get(8) ends with 0 where a list could not be fetched, unless it is new enough for the option above.
        has_failed = process.returncode != 0 or any(line.startswith("Failed to fetch") for line in complaints)
        if has_failed:
            raise join_errors(
                [(f"the lists of packages cannot be had: {line}", _source_hint(line)) for line in complaints or ["?"]]
            )

    def missing_files(self, requirements: Sequence[PackageRequirement]) -> tuple[DebFile, ...]:
        """Return the package files that the target lacks, dependencies included. Raises BundleError."""
        if not requirements:
            return ()
        arguments = ["install", "--print-uris", "-q", "-o", "Acquire::ForceHash=SHA256"]
        process = self._apt(*arguments, *_INSTALL_OPTIONS, *(each.apt_argument for each in requirements))
        if process.returncode != 0:
            problems = _unmet_dependencies(process) or _marked_messages(process, "E:")
            hint = "correct the names or versions in the declaration, or the sources"
            raise join_errors([(f"the packages cannot be resolved: {line}", hint) for line in problems or ["?"]])
        lines = process.stdout.decode(errors="replace").splitlines()
        matches = [(line, _URI.fullmatch(line.strip())) for line in lines if line.startswith("'")]
        bad = [line for line, match in matches if match is None]
        if bad:
            raise BundleError(f"a source tells no SHA-256 of its packages: {bad[0]}", hint="take another source")
        return tuple(
            DebFile(match["name"], int(match["size"]), match["sha256"], unquote(match["uri"]))
            for _, match in matches
            if match is not None
        )

    def has(self, file: DebFile) -> bool:
        """Return whether a file is downloaded and complete; a damaged file is removed."""
        path = self.archives / file.name
        if not path.is_file():
            return False
        if path.stat().st_size == file.size and sha256_of(path) == file.sha256:
            return True
        path.unlink()
        return False

    def fetch(
        self, requirements: Sequence[PackageRequirement], files: Sequence[DebFile], tell: Callable[[float], None]
    ) -> None:
        """Fetch missing files; `tell` receives the progress from 0 to 1. Raises BundleError."""
        there = [self.has(file) for file in files]
        if not all(there):
            self._download([each.apt_argument for each in requirements], tell)
        missing = [file.name for file in files if not self.has(file)]
        if missing:
            hint = "type the same again: what was fetched is kept"
            raise join_errors([(f"{name} did not arrive as its source describes it", hint) for name in missing])

    def _download(self, package_names: list[str], tell: Callable[[float], None]) -> None:
        arguments = ["install", "--download-only", "-q", "-o", "APT::Status-Fd=1", *_INSTALL_OPTIONS, *package_names]
        command = [manifest.program("apt-get"), *arguments]
        lines: list[str] = []
        with subprocess.Popen(  # noqa: S603 - a program of the system, and names of packages
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=self._environment(),
        ) as process:
            if process.stdout is None:
                raise AssertionError("the output of apt-get is a pipe")
            for line in process.stdout:
                if match := _STATUS.match(line):
                    tell(float(match["share"]) / 100)
                elif line.startswith(("E: ", "W: ", "Err")):
                    lines.append(line.strip())
        if process.returncode != 0:
            hint = "type the same again: what was fetched is kept"
            raise join_errors([(f"fetching failed: {line}", hint) for line in lines or ["apt-get said nothing"]])

    def _apt(self, *arguments: str) -> subprocess.CompletedProcess[bytes]:
        return manifest.run(["apt-get", *arguments], self._environment())

    def _environment(self) -> dict[str, str]:
        import os  # noqa: PLC0415 - shadowed nowhere else

        return {**os.environ, "LC_ALL": "C.UTF-8", "APT_CONFIG": str(self.folder / "apt.conf")}


_INSTALL_OPTIONS = ("-y", "--no-install-recommends", "--no-remove", "--allow-downgrades")
"""Options with which the module `packages` installs packages."""


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _settings(root: Root, target: BundleTarget) -> str:
    places = {
        "Dir": f"{root.folder}/",
        "Dir::State": f"{root.folder}/state/",
        "Dir::State::lists": f"{root.lists}/",
        "Dir::State::status": f"{root.folder}/status",
        "Dir::Cache": f"{root.folder}/cache/",
        "Dir::Cache::archives": f"{root.archives}/",
        "APT::Architecture": target.architecture,
        "APT::Get::List-Cleanup": "false",
        "APT::Sandbox::User": "root",
        "APT::Keep-Downloaded-Packages": "true",
        "Acquire::Languages": "none",
        "Acquire::Retries": "3",
        "Acquire::http::Timeout": "120",
        "Acquire::https::Timeout": "120",
        "Debug::NoLocking": "true",
    }
    rows = "".join(f'{name} "{value}";\n' for name, value in places.items())
    return f'{rows}APT::Architectures {{ "{target.architecture}"; }};\n'


def _proxies() -> str:
    """Return the proxy settings of this computer's apt."""
    lines = manifest.run(["apt-config", "dump"]).stdout.decode(errors="replace").splitlines()
    return "".join(f"{line}\n" for line in lines if re.match(r'Acquire::https?::Proxy(::\S+)? ".+";', line))


def _marked_messages(process: subprocess.CompletedProcess[bytes], *marks: str) -> list[str]:
    lines = (process.stdout + process.stderr).decode(errors="replace").splitlines()
    return list(dict.fromkeys(line.split(":", 1)[1].strip() for line in lines if line.startswith(marks)))


def _unmet_dependencies(process: subprocess.CompletedProcess[bytes]) -> list[str]:
    lines = process.stdout.decode(errors="replace").splitlines()
    return [line.strip() for line in lines if line.startswith(" ") and "Depends:" in line]


def _source_hint(line: str) -> str:
    if "EXPKEYSIG" in line:
        return "the key has expired: fetch the archive's new one, and name it in the declaration"
    if "NO_PUBKEY" in line or "not signed" in line:
        return "the key is not the one that signs this source: `keyring=FILE`, or `key_file` in the declaration"
    return "is this computer online? `mirror=` names another archive"


_DATE = "Sat, 01 Jan 2000 00:00:00 UTC"
"""apt refuses an index from the future, and a board's clock may be in the past; see `signing`."""


@dataclass(frozen=True, slots=True)
class ResolvedPackage:
    """A .deb file with its control fields."""

    name: str
    version: str
    architecture: str
    control: str
    size: int
    sha256: str

    @property
    def file(self) -> str:
        """File name in a repository; colons are replaced, because USB sticks' file systems refuse them."""
        return f"{self.name}_{self.version.replace(':', '-')}_{self.architecture}.deb"


def read_package(deb: Path, sha256: str) -> ResolvedPackage:
    """Read the control fields of a package file. Raises BundleError."""
    process = manifest.run(["dpkg-deb", "--field", str(deb)])
    control = process.stdout.decode(errors="replace").rstrip()
    fields = next(paragraphs(control), {})
    if process.returncode != 0 or not {"Package", "Version", "Architecture"} <= fields.keys():
        raise BundleError(f"{deb.name} is no Debian package", hint="remove it, and type the same again")
    return ResolvedPackage(
        fields["Package"], fields["Version"], fields["Architecture"], control, deb.stat().st_size, sha256
    )


def index(packages: Iterable[ResolvedPackage], target: BundleTarget, signer: manifest.BundleSigner) -> dict[str, bytes]:
    """Return the index files by name; packages must be in `pool` beside them."""
    sorted_packages = sorted(packages, key=lambda each: (each.name, each.version, each.architecture))
    text = "\n".join(
        f"{each.control}\nFilename: ./pool/{each.file}\nSize: {each.size}\nSHA256: {each.sha256}\n"
        for each in sorted_packages
    )
    plain = text.encode()
    xz_data = lzma.compress(plain)
    sums = "".join(
        f" {hashlib.sha256(data).hexdigest()} {len(data)} {name}\n"
        for name, data in (("Packages", plain), ("Packages.xz", xz_data))
    )
    release = (
        f"Origin: ATLANTIS bundle\nLabel: ATLANTIS bundle\nSuite: {target.codename}\nCodename: {target.codename}\n"
        f"Date: {_DATE}\nArchitectures: {target.architecture} all\nSHA256:\n{sums}"
    )
    return {"InRelease": signer.sign_inline(release), "Packages.xz": xz_data}


@dataclass(frozen=True, slots=True)
class Distribution:
    """Addresses and keyring of a distribution's package archive."""

    archive: str
    ports: str
    """Archive of the architectures other than those of PCs."""
    security: str
    """Appended to the archive's address; empty: the archive holds the security updates as well."""
    components: str
    keyring: str
    keyring_package: str


DISTRIBUTIONS: Mapping[str, Distribution] = {
    "debian": Distribution(
        archive="http://deb.debian.org/debian",
        ports="http://deb.debian.org/debian",
        security="-security",
        components="main",
        keyring="/usr/share/keyrings/debian-archive-keyring.gpg",
        keyring_package="debian-archive-keyring",
    ),
    "ubuntu": Distribution(
        archive="http://archive.ubuntu.com/ubuntu",
        ports="http://ports.ubuntu.com/ubuntu-ports",
        security="",
        components="main restricted universe multiverse",
        keyring="/usr/share/keyrings/ubuntu-archive-keyring.gpg",
        keyring_package="ubuntu-keyring",
    ),
}
_OF_PCS = ("amd64", "i386")


def archive(target: BundleTarget, mirror: str | None, keyring: Path | None) -> tuple[PackageSource, RequirementKey]:
    """Return the source of a target's own distribution and its signing key. Raises BundleError.

    `mirror` replaces the archive's address (Debian's security updates are then expected at MIRROR-security, as mirrors
    have it); `keyring` replaces the distribution's own.
    """
    row = DISTRIBUTIONS[target.distribution]
    base = (mirror or (row.archive if target.architecture in _OF_PCS else row.ports)).rstrip("/")
    place = PurePosixPath(row.keyring)
    name = target.codename
    suites = f"{name} {name}-updates" + ("" if row.security else f" {name}-security")
    text = _stanza(base, suites, row, place)
    if row.security:
        text += "\n" + _stanza(base + row.security, f"{name}-security", row, place)
    return PackageSource(f"/etc/apt/sources.list.d/{target.distribution}.sources", text), RequirementKey(
        str(place), _key(row, keyring)
    )


def _stanza(base: str, suites: str, row: Distribution, keyring: PurePosixPath) -> str:
    return f"Types: deb\nURIs: {base}\nSuites: {suites}\nComponents: {row.components}\nSigned-By: {keyring}\n"


def _key(row: Distribution, keyring: Path | None) -> bytes:
    path = keyring or Path(row.keyring)
    try:
        return path.read_bytes()
    except OSError as error:
        hint = "`keyring=` names a file" if keyring else f"sudo apt install {row.keyring_package}, or add keyring=FILE"
        raise BundleError(
            f"the key of the distribution cannot be read: {path}: {error.strerror or error}", hint=hint
        ) from error
