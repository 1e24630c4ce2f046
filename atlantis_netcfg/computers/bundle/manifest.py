"""The manifest of a bundle (`manifest.json`, signed by `manifest.json.asc`), and the signing keys.

Paths of `files` are below the bundle's folder; those of `held` below /var/lib/atlantis/bundle/ID of a host's board.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from atlantis_netcfg.computers.bundle.requirements import BundleError
from atlantis_netcfg.core import temporary
from atlantis_netcfg.core.paths import private_directory
from atlantis_netcfg.runs import write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


FORMAT = 1
MANIFEST = "manifest.json"
SIGNATURE = "manifest.json.asc"
KEY = "key.gpg"
"""Public key that verifies the signatures of manifest and repositories."""


def _require_relative_path(path: str) -> str:
    parts = PurePosixPath(path).parts
    if not re.fullmatch(r"[A-Za-z0-9._+~@:/-]+", path) or path.startswith("/") or ".." in parts or not parts:
        raise ValueError("not a path below the bundle")
    return path


Inside = Annotated[str, AfterValidator(_require_relative_path)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Data(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class BundleFile(_Data):
    """One file of the bundle; `size` in bytes."""

    path: Inside
    size: Annotated[int, Field(ge=0)]
    sha256: Sha256


class BundledLibrary(_Data):
    """A repository at the commit to which its revision resolved when the bundle was made."""

    url: str
    revision: str
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40}([0-9a-f]{24})?$")]


class BundleImage(_Data):
    """Vendor image for cards, for information; `path` is None where only the checksum is kept."""

    name: str
    sha256: Sha256
    path: Inside | None = None


class HostPart(_Data):
    """Contents of the bundle for one host."""

    architecture: str
    distribution: str
    codename: str
    wished: dict[str, str | None]
    """Package -> requested version; None: any."""
    installed: dict[str, str]
    """Requested packages that were already on the system against which the bundle was resolved."""
    packages: dict[str, str]
    """Package -> version in its repository."""
    libraries: tuple[BundledLibrary, ...] = ()
    held: dict[Inside, Inside]
    """Path on the board -> path in the bundle."""


class Manifest(_Data):
    """Contents of a whole bundle."""

    format: Literal[1] = 1
    id: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    """Id of the content: bundles with the same content have the same id."""
    site: str
    made: str
    """Creation time: UTC, ISO 8601."""
    tool: str
    revision: str
    """Revision of the inventory, as `provision inventory validate` shows it."""
    key: Annotated[str, Field(pattern=r"^[0-9A-F]{40}$")]
    """Fingerprint of the key that signs it."""
    files: tuple[BundleFile, ...]
    hosts: dict[str, HostPart]
    image: BundleImage | None = None

    @property
    def size(self) -> int:
        """Total size of all files in bytes."""
        return sum(file.size for file in self.files)

    def of(self, host: str) -> dict[str, BundleFile]:
        """Return one host's files by their path on the board."""
        files = {file.path: file for file in self.files}
        return {path: files[inside] for path, inside in sorted(self.hosts[host].held.items())}

    def encode(self) -> bytes:
        """Return the manifest as JSON text."""
        return f"{json.dumps(self.model_dump(mode='json'), indent=1, ensure_ascii=False)}\n".encode()


def content_id(files: tuple[BundleFile, ...], hosts: dict[str, HostPart]) -> str:
    """Compute the `id` of a manifest from its contents."""
    data = [[file.model_dump() for file in files], {name: part.model_dump() for name, part in hosts.items()}]
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def read_manifest(data: bytes, label: str) -> Manifest:
    """Parse and validate a manifest. Raises BundleError."""
    try:
        result = json.loads(data)
    except ValueError as error:
        raise _damage_error(label) from error
    format_number = result.get("format") if isinstance(result, dict) else None
    if isinstance(format_number, int) and format_number != FORMAT:
        raise BundleError(
            f"{label} is of format {format_number}, and this toolkit knows format {FORMAT}",
            hint="take the toolkit that made it, or make the bundle anew",
        )
    try:
        manifest = Manifest.model_validate(result)
    except ValidationError as error:
        raise _damage_error(label) from error
    if not {inside for part in manifest.hosts.values() for inside in part.held.values()} <= {
        file.path for file in manifest.files
    }:
        raise _damage_error(label)
    return manifest


def _damage_error(label: str) -> BundleError:
    return BundleError(f"{label} cannot be understood", hint="the bundle is damaged: copy it again")


_PACKAGES = {
    "apt-get": "apt",
    "apt-config": "apt",
    "dpkg-deb": "dpkg",
    "git": "git",
    "gpg": "gpg gpg-agent",
    "gpgconf": "gpgconf",
    "gpgv": "gpgv",
    "ssh": "openssh-client",
}
MAKERS = {name: _PACKAGES[name] for name in ("apt-get", "apt-config", "dpkg-deb", "git", "gpg", "gpgv")}
"""Programs that build a bundle -> Debian packages that hold them."""


def program(name: str) -> str:
    """Return the path of a program. Raises BundleError if it is not installed."""
    result = shutil.which(name)
    if result is None:
        raise BundleError(f"`{name}` is not installed on this computer", hint=f"sudo apt install {_PACKAGES[name]}")
    return result


def require_programs() -> None:
    """Raise BundleError with all missing programs, before anything is unpacked or fetched."""
    missing = [name for name in MAKERS if shutil.which(name) is None]
    if missing:
        tools, verb = " and ".join(f"`{name}`" for name in missing), "is" if len(missing) == 1 else "are"
        packages = " ".join(dict.fromkeys(_PACKAGES[name] for name in missing))
        raise BundleError(f"{tools} {verb} not installed on this computer", hint=f"sudo apt install {packages}")


def run(
    command: Sequence[str], environment: Mapping[str, str] | None = None, stdin: bytes | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a program in the C locale; the caller checks the exit code."""
    return subprocess.run(  # noqa: S603 - a program of the system, and arguments that are ours
        [program(command[0]), *command[1:]],
        input=stdin if stdin is not None else b"",
        capture_output=True,
        check=False,
        env={**os.environ, "LC_ALL": "C.UTF-8", **(environment or {})},
    )


_KEY_MADE_AT = "20000101T000000"
SIGNED_AT = "20000102T000000"
_NAME = "ATLANTIS bundles"
_SECRET = "signing-key.asc"  # noqa: S105 - the name of a file


@dataclass(frozen=True, slots=True)
class Keys:
    """Keys in `<state>/bundle`: this computer's key, and the fingerprints that a person has accepted.

    A computer has one key for all its bundles. Anybody could sign a bundle that brings its own key, while a permanent
    key can be recognised. Bundles of another computer are used only after a person has accepted its fingerprint.
    """

    folder: Path

    @classmethod
    def of(cls, state: Path) -> Keys:
        """Return the keys of a state directory."""
        return cls(state / "bundle")

    def signer(self) -> BundleSigner:
        """Return this computer's key; it is generated at first use."""
        private_directory(self.folder)
        place = self.folder / _SECRET
        if not place.exists():
            with _home() as home:
                quick_key = ["--passphrase", "", "--quick-generate-key", _NAME, "ed25519", "sign", "never"]
                _gpg(home, *quick_key, at=_KEY_MADE_AT)
                write_atomically(place, _gpg(home, "--armor", "--export-secret-keys"))
        secret = place.read_bytes()
        with _home() as home:
            _gpg(home, "--import", stdin=secret)
            key_list = _gpg(home, "--with-colons", "--list-keys").decode()
            public = _gpg(home, "--export")
        match = re.search(r"^fpr:+([0-9A-F]{40}):", key_list, re.MULTILINE)
        if match is None:
            raise BundleError(f"{place} holds no key", hint="remove it: a new key is made, and made known again")
        return BundleSigner(match[1], public, secret)

    def accepts(self, fingerprint: str) -> bool:
        """Return whether bundles signed by that key are trusted."""
        return (self.folder / "accepted" / fingerprint).exists() or (
            (self.folder / _SECRET).exists() and self.signer().fingerprint == fingerprint
        )

    def accept(self, fingerprint: str) -> None:
        """Trust bundles signed by that key from now on; a person has confirmed the fingerprint."""
        folder = private_directory(private_directory(self.folder) / "accepted")
        write_atomically(folder / fingerprint, b"")


@dataclass(frozen=True, slots=True)
class BundleSigner:
    """A signing key.

    Signatures are dated `SIGNED_AT`: gpgv(1) refuses a key or a signature from the future, and a board without a
    battery starts years in the past. The manifest has the real date. The key is one day older, because gpg refuses its
    own key if it is one second younger than the signature. The clock is frozen (`!`, gpg(1)): the same contents always
    have the same signature.
    """

    fingerprint: str
    public: bytes
    """Public key as `Signed-By` of apt takes it."""
    secret: bytes

    def __repr__(self) -> str:
        return f"Signer({self.fingerprint})"

    def sign_inline(self, text: str) -> bytes:
        """Return the text with an inline signature, like apt's InRelease."""
        return self._sign("--clear-sign", text.encode())

    def sign_detached(self, data: bytes) -> bytes:
        """Return a detached signature of the data."""
        return self._sign("--detach-sign", data)

    def _sign(self, how: str, data: bytes) -> bytes:
        with _home() as home:
            _gpg(home, "--import", stdin=self.secret)
            return _gpg(home, "--digest-algo", "SHA512", "--armor", how, stdin=data)


def find_signer(data: bytes, signature: bytes, public: bytes) -> str | None:
    """Return the fingerprint of the key that signed the data, or None if the signature is not valid."""
    with temporary.folder("gpg") as place:
        for name, content in (("data", data), ("data.asc", signature), ("key.gpg", public)):
            (place / name).write_bytes(content)
        command = ["gpgv", "--homedir", str(place), "--keyring", str(place / "key.gpg"), "--status-fd", "1"]
        process = run([*command, str(place / "data.asc"), str(place / "data")])
    valid = re.search(r"^\[GNUPG:\] VALIDSIG ([0-9A-F]{40}) ", process.stdout.decode(errors="replace"), re.MULTILINE)
    return valid[1] if valid is not None and process.returncode == 0 else None


@contextmanager
def _home() -> Iterator[Path]:
    """Yield a gpg(1) home with a path short enough for the agent's socket; the agent ends with it."""
    with temporary.folder("gpg", Path("/tmp")) as folder:  # noqa: S108 - it is private
        try:
            yield folder
        finally:
            run(["gpgconf", "--homedir", str(folder), "--kill", "all"])


def _gpg(home: Path, *arguments: str, stdin: bytes | None = None, at: str = SIGNED_AT) -> bytes:
    options = ["--homedir", str(home), "--batch", "--no-tty", "--quiet", "--pinentry-mode", "loopback"]
    process = run(["gpg", *options, "--faked-system-time", f"{at}!", *arguments], stdin=stdin)
    if process.returncode != 0:
        lines = process.stderr.decode(errors="replace").strip().splitlines()
        raise BundleError(f"gpg has refused: {lines[-1] if lines else 'without a word'}", hint="gpg --version")
    return process.stdout
