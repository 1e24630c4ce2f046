"""`provision vpn accept`: take the identity of a declared computer out of the file that was handed out for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AUTHORITY, INVENTORY

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.secret import Secret

COMMAND = Command(
    "vpn accept",
    "take a computer's identity out of its hand-out, so that `provision site=…` can bring it there",
    words=(
        Word("file", "the sealed hand-out", required=True, example="coastal-gateway.tar.age"),
        Word("key", "file (mode 0600) with your age key, where it was sealed to that", example="age.key"),
        AUTHORITY,
        INVENTORY,
    ),
    flags=(PASSPHRASE_FD, JSON),
    details="For a laptop without the authority: the identity is kept in the folder `hosts` of it, mode 0600.",
)
_LARGEST = 1_000_000


def run(arguments: Arguments) -> ExitCode:
    """Open it, check it, keep it."""
    from datetime import UTC, datetime
    from pathlib import Path

    from atlantis_netcfg.cli import _members, _vpn
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.enrolment_package.package import accept

    declaration = _vpn.declared(arguments)
    data = _bytes(Path(arguments.word("file")), "the hand-out")
    accepted = accept(declaration, data, _opener(arguments), _vpn.folder(arguments), now=datetime.now(UTC))
    member, certificate = accepted.identity.member, accepted.identity.certificate
    values = {
        "name": member.name,
        "common_name": certificate.common_name,
        "address": str(member.address),
        "not_after": certificate.not_after.isoformat(timespec="seconds"),
        "file": str(accepted.path),
        "already": accepted.already,
    }
    how = "already so" if accepted.already else "accepted"
    lines = [
        f"{member.name}: {how}, address {member.address}, good until {certificate.not_after:%Y-%m-%d}",
        f"  kept in {accepted.path}; `{_members.bringing(declaration, member)}` brings it there",
    ]
    return _vpn.tell(arguments, ExitCode.DONE, values, lines)


def _opener(arguments: Arguments) -> Secret:
    """The key out of its file, or the passphrase."""
    from pathlib import Path

    from atlantis_netcfg.cli._passphrase import passphrase_prompt
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.core.secret import Secret

    named = arguments.optional("key")
    if named is None:
        return passphrase_prompt(arguments, "the passphrase of the hand-out")()
    path = Path(named)
    text = _bytes(path, "the key").decode(errors="replace")
    if path.stat().st_mode & 0o077:
        raise UsageError(f"others may read the key {path}", hint=f"type `chmod 600 {path}`")
    lines = [line.strip() for line in text.splitlines() if line.startswith("AGE-SECRET-KEY-")]
    if len(lines) != 1:
        raise UsageError(f"{path} holds {len(lines)} age keys", hint="name the file that age-keygen has made")
    return Secret(lines[0])


def _bytes(path: Path, what: str) -> bytes:
    from atlantis_netcfg.core.errors import UsageError

    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
    except (OSError, ValueError) as error:
        raise UsageError(f"{what} cannot be read: {path}", hint=getattr(error, "strerror", None)) from error
    if len(data) > _LARGEST:
        raise UsageError(f"{path} is too large for {what}")
    return data
