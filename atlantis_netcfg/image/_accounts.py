"""Who may log in: the technicians' keys, and no password. Pure functions over the texts of the image."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.image._errors import ImageRefused
from atlantis_netcfg.image.edits import Directory, File
from atlantis_netcfg.image.wish import Account, Seen, Wish

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.image.edits import Edit

__all__ = ["PASSWD", "SHADOW", "SSHD", "SSHD_PARTS", "accounts", "passwords", "unlocked"]

PASSWD, SHADOW = "/etc/passwd", "/etc/shadow"
SSHD, SSHD_PARTS = "/etc/ssh/sshd_config", "/etc/ssh/sshd_config.d"
_OURS = f"{SSHD_PARTS}/00-atlantis.conf"
_INCLUDE = f"Include {SSHD_PARTS}/*.conf"
_SSHD_TEXT = """\
# Keys only: written by `provision image`. The first value of an option counts (sshd_config(5)).
PasswordAuthentication no
KbdInteractiveAuthentication no
ChallengeResponseAuthentication no
PermitEmptyPasswords no
PermitRootLogin prohibit-password
PubkeyAuthentication yes
"""


def accounts(seen: Seen, request: Wish) -> Iterator[Edit]:
    """The technicians' keys, passwords removed, and an SSH server that takes keys only. Raises ImageRefused."""
    account = _account(seen.text(PASSWD), request.user)
    folder = f"{account.home.rstrip('/')}/.ssh"
    yield Directory(folder, 0o700, account.owner)
    keys = "".join(f"{key}\n" for key in request.keys)
    yield File(f"{folder}/authorized_keys", keys.encode(), 0o600, account.owner)
    yield from passwords(seen)
    if SSHD not in seen.files:
        raise ImageRefused(f"the image has no {SSHD}: nobody could log in", hint="take an image with an SSH server")
    if SSHD_PARTS not in seen.present:
        yield Directory(SSHD_PARTS)
    yield File(_OURS, _SSHD_TEXT.encode())
    text = seen.text(SSHD)
    first = next((line.split() for line in text.splitlines() if line.split() and not line.lstrip().startswith("#")), [])
    if first != _INCLUDE.split():
        yield File(SSHD, f"{_INCLUDE}\n{text}".encode())


def _account(passwd: str, name: str) -> Account:
    rows = {row[0]: row for row in (line.split(":") for line in passwd.splitlines()) if len(row) == 7}  # noqa: PLR2004
    row = rows.get(name)
    if row is None:
        people = ", ".join(item for item, row in rows.items() if row[6].endswith("sh")) or "none"
        raise ImageRefused(f"the image has no account `{name}`", hint=f"declare `user`: the image has {people}")
    if row[6].endswith(("nologin", "false")):
        raise ImageRefused(f"account `{name}` of the image cannot log in: its shell is {row[6]}")
    return Account(name, (int(row[2]), int(row[3])), row[5] or "/", row[6])


def unlocked(shadow: str) -> tuple[str, ...]:
    """The accounts that a password, or none at all, would open."""
    rows = (line.split(":") for line in shadow.splitlines())
    return tuple(row[0] for row in rows if len(row) > 1 and not row[1].startswith(("!", "*")))


def passwords(seen: Seen) -> Iterator[Edit]:
    """No account has a password; `*` rather than `!`, which sshd without PAM takes for a locked account.

    A password that must be changed at the first login would stand in the way of the key, so that its age goes too.
    """
    shadow, passwd = seen.text(SHADOW), seen.text(PASSWD)
    rows = [line.split(":") for line in shadow.splitlines()]
    open_ones = set(unlocked(shadow))
    for row in rows:
        if row[0] in open_ones:
            row[1] = "*"
        if len(row) > 2 and row[2] == "0":  # noqa: PLR2004 - the day of the last change: 0 forces one (shadow(5))
            row[2] = ""
    text = "".join(f"{':'.join(row)}\n" for row in rows)
    if SHADOW not in seen.files:
        raise ImageRefused(f"the image has no {SHADOW}: its passwords cannot be removed")
    if text != shadow:
        yield File(SHADOW, text.encode(), 0o640, (0, _group(seen, "shadow")))
    people = [line.split(":") for line in passwd.splitlines()]
    for row in people:
        if len(row) > 1 and row[1] != "x":
            row[1] = "x"  # a password, or none, in the file that everybody reads
    message = "".join(f"{':'.join(row)}\n" for row in people)
    if message != passwd:
        yield File(PASSWD, message.encode())


def _group(seen: Seen, name: str) -> int:
    rows = (line.split(":") for line in seen.text("/etc/group").splitlines())
    return next((int(row[2]) for row in rows if row[0] == name and len(row) > 2), 0)  # noqa: PLR2004
