"""Files encrypted to a passphrase or a recipient's key: age, which everybody can install, or ansible-vault.

The CA's key is sealed by age with scrypt: a guess costs 256 MiB of memory and about a second. PKCS #8's own encryption
costs a third of a millisecond, and ansible-vault's 10 000 rounds a few (facts 12), so its passphrase must be stronger.
The strength is estimated by zxcvbn, which knows words, names, dates and keyboard patterns.
"""

from __future__ import annotations

import base64
import math
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pyrage

from atlantis_netcfg.core import passwords
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.vpn.pki import age_file, keys

if TYPE_CHECKING:
    from atlantis_netcfg.core.secret import Secret

SEAL_GUESSES = 10**12
"""Guesses by a thousand computers in thirty years, at a second each. Nothing limits guesses at a file."""
VAULT_GUESSES = 10**16
"""Guesses by the same computers in that time, with ten thousand rounds of SHA-256 each."""
_SCRYPT = re.compile(rb"-> scrypt \S+ ([0-9]{1,2})\n")
_MEMORY = Path("/proc/meminfo")
_ARMOR = re.compile(
    rb"\s*-----BEGIN AGE ENCRYPTED FILE-----\r?\n([A-Za-z0-9+/=\r\n]+)-----END AGE ENCRYPTED FILE-----\s*"
)
_BY_PASSPHRASE = b"age-encryption.org/v1\n-> scrypt "
_X25519 = re.compile(r"age1[02-9ac-hj-np-z]{58}")


def seal(data: bytes, passphrase: Secret) -> bytes:
    """Encrypt to text that `age --decrypt` also opens. Deliberately slow. Raises WeakPassphrase, SealTooLarge."""
    check_passphrase(passphrase, SEAL_GUESSES)
    needed_bytes, free = _scrypt_bytes(age_file.WORK_FACTOR), _free_bytes()
    if free is not None and free < needed_bytes:
        raise keys.SealTooLarge(
            f"sealing it needs {arg(needed_bytes >> 20)} MiB of memory, but this computer has only {arg(free >> 20)} "
            "MiB free",
            hint=_LARGER,
        )
    return age_file.encrypt(data, passphrase.reveal())


def unseal(sealed_data: bytes, passphrase: Secret) -> bytes:
    """Decrypt a file of `seal` or `age --passphrase`. Raises WrongPassphrase, CorruptSealError, SealTooLarge."""
    if not _binary(sealed_data).startswith(_BY_PASSPHRASE):
        raise keys.CorruptSealError("not a file that age sealed with a passphrase", hint=_RESTORE)
    _check_memory(opening_bytes(sealed_data))
    try:
        return bytes(pyrage.passphrase.decrypt(sealed_data, passphrase.reveal()))
    except pyrage.DecryptError as error:
        raise _opening(error) from None


def check_recipient(recipient: str) -> None:
    """Raise InvalidRecipientError unless it is a public key: `age1…`, or an SSH key (ed25519, RSA)."""
    _recipient(recipient)


def seal_for(data: bytes, recipient: str, *others: str) -> bytes:
    """Encrypt to the holders of these keys, for `age --decrypt --identity`. Raises InvalidRecipientError."""
    return bytes(pyrage.encrypt(data, [_recipient(item) for item in (recipient, *others)], armored=True))


def opening_bytes(sealed_data: bytes) -> int:
    """Return the memory that scrypt needs to open a file sealed by age with a passphrase; 0 if there is none."""
    match = _SCRYPT.search(_binary(sealed_data))
    return _scrypt_bytes(int(match[1])) if match is not None else 0


def _scrypt_bytes(cost: int) -> int:
    """Return the memory for a cost: 128 bytes, 8 times, 2^cost (RFC 7914)."""
    return 128 * 8 << cost


def check_passphrase(passphrase: Secret, guesses: int) -> None:
    """Raise WeakPassphrase if the estimated number of guesses is smaller."""
    text = passphrase.reveal()
    if not text:
        raise keys.WeakPassphrase("the passphrase is empty", hint=_STRONGER)
    estimate, why = passwords.guesses(text)
    if estimate < guesses:
        raise keys.WeakPassphrase(
            f"the passphrase is too weak: about {arg(_power(math.log10(estimate)))} guesses find it, at least "
            f"{arg(_power(math.log10(guesses)))} are required" + (f" ({arg(why)})" if why else ""),
            hint=_STRONGER,
        )


def unseal_with(sealed_data: bytes, identity: Secret) -> bytes:
    """Decrypt data encrypted to the public half of `AGE-SECRET-KEY-1…`.

    Raises InvalidRecipientError, WrongPassphrase, CorruptSealError.
    """
    _binary(sealed_data)
    try:
        key = pyrage.x25519.Identity.from_str(identity.reveal().strip())
    except pyrage.IdentityError:
        raise keys.InvalidRecipientError("not an age key", hint="an age key begins with AGE-SECRET-KEY-1") from None
    try:
        return bytes(pyrage.decrypt(sealed_data, [key]))
    except pyrage.DecryptError as error:
        if str(error) == "No matching keys found":
            raise keys.WrongPassphrase(
                "it was sealed for another key", hint="use the key that it was sealed for"
            ) from None
        raise keys.CorruptSealError("the sealed file is truncated or damaged", hint=_RESTORE) from None


def vault_seal(data: bytes, passphrase: Secret) -> bytes:
    """Encrypt like ansible-vault. Raises WeakPassphrase: guessing is cheap here, so the passphrase must be long."""
    check_passphrase(passphrase, VAULT_GUESSES)
    return bytes(_vault(passphrase).encrypt(data, salt=os.urandom(32)))  # type: ignore[attr-defined] # no types


def vault_unseal(sealed_data: bytes, passphrase: Secret) -> bytes:
    """Decrypt an ansible-vault file. Raises WrongPassphrase, CorruptSealError."""
    if not sealed_data.startswith(b"$ANSIBLE_VAULT;"):
        raise keys.CorruptSealError("not a file encrypted with ansible-vault", hint=_RESTORE)
    from ansible.errors import AnsibleError  # noqa: PLC0415 - as below
    from ansible.parsing.vault import AnsibleVaultFormatError  # noqa: PLC0415

    try:
        return bytes(_vault(passphrase).decrypt(sealed_data))  # type: ignore[attr-defined] # no types
    except AnsibleVaultFormatError:
        raise keys.CorruptSealError("the sealed file is truncated or damaged", hint=_RESTORE) from None
    except AnsibleError:
        raise _wrong() from None


_MAX_SHOWN = 30
"""Maximum characters shown of an invalid recipient: enough to recognise it, but not all of a possible secret."""
_LARGER = "close other programs, or use a computer with more memory"
_RESTORE = "restore it from your backup of the authority"
_STRONGER = "use six words chosen with dice, and do not keep them together with the authority's folder"


def _check_memory(needed_bytes: int) -> None:
    """Raise SealTooLarge before scrypt allocates too much: a small computer's kernel would silently kill a process."""
    free = _free_bytes()
    if free is not None and free < needed_bytes:
        raise keys.SealTooLarge(
            f"opening it needs {arg(needed_bytes >> 20)} MiB of memory, but this computer has only {arg(free >> 20)} "
            "MiB free",
            hint=_LARGER,
        )


def _free_bytes() -> int | None:
    """Return the memory available to programs, as estimated by the kernel; None if unknown."""
    try:
        match = re.search(r"^MemAvailable: +([0-9]+) kB$", _MEMORY.read_text(encoding="ascii"), re.MULTILINE)
    except (OSError, ValueError):
        return None
    return int(match[1]) << 10 if match is not None else None


def _power(number: float) -> str:
    return f"10^{number:.0f}"


def _binary(sealed_data: bytes) -> bytes:
    """Return an age file without its armour."""
    match = _ARMOR.fullmatch(sealed_data)
    try:
        data = base64.b64decode(b"".join(match[1].split()), validate=True) if match else sealed_data
    except ValueError:
        data = b""
    if not data.startswith(b"age-encryption.org/v1\n"):
        raise keys.CorruptSealError("the sealed file is truncated or damaged", hint=_RESTORE)
    return data


def _opening(error: pyrage.DecryptError) -> keys.WrongPassphrase | keys.CorruptSealError | keys.SealTooLarge:
    """Return the error for a failed decryption; age does not distinguish a wrong passphrase from a damaged header."""
    if str(error) == "Decryption failed":
        return _wrong()
    if str(error).startswith("Excessive work"):
        return keys.SealTooLarge(
            "it was sealed on a much faster computer; opening it here would take too long",
            hint="open it on a faster computer",
        )
    return keys.CorruptSealError("the sealed file is truncated or damaged", hint=_RESTORE)


def _wrong() -> keys.WrongPassphrase:
    return keys.WrongPassphrase(
        "wrong passphrase, or the file was changed",
        hint="type it again; if you are sure of it, the file was changed: restore it from a backup",
    )


def _recipient(text: str) -> pyrage.x25519.Recipient | pyrage.ssh.Recipient:
    try:
        if _X25519.fullmatch(text):
            return pyrage.x25519.Recipient.from_str(text)
        if text.startswith(("ssh-ed25519 ", "ssh-rsa ")) and text.isprintable():
            return pyrage.ssh.Recipient.from_str(text)
    except pyrage.RecipientError:
        pass
    secret = "AGE-SECRET-KEY" in text.upper() or "PRIVATE KEY" in text.upper()
    excerpt = text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}…"
    raise keys.InvalidRecipientError(
        "this is a secret key; the recipient's public key is needed"
        if secret
        else f"not a recipient's key: {arg(excerpt)!r}",
        hint="ask for the line that age-keygen prints (age1…), or for an ssh-ed25519 public key",
    )


def _vault(passphrase: Secret) -> object:
    # ansible reads its configuration when it is imported: who seals by age does not need it.
    from ansible.parsing.vault import VaultLib, VaultSecret  # noqa: PLC0415

    return VaultLib([("default", VaultSecret(passphrase.reveal().encode()))])
