import base64
import json
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pyrage
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.pki import age_file

DATA = b"-----BEGIN PRIVATE KEY-----\n\x00\xff\n"
RIGHT, WRONG = Secret("orchard-lantern-seventeen-\u00e5"), Secret("canary-canary-canary-canary")
IDENTITY = pyrage.x25519.Identity.generate()
STRENGTH = "atlantis_netcfg.vpn.pki.age_file.WORK_FACTOR"
REAL = age_file.WORK_FACTOR
"""Taken before the tests begin, which seal at once (tests/conftest.py)."""


@cache
def sealed() -> bytes:
    return pki.seal(DATA, RIGHT)


def body(edit: Callable[[bytes], bytes]) -> bytes:
    """A sealed file whose inside was changed, in good armour."""
    head, *rows, tail = sealed().splitlines()
    data = edit(base64.b64decode(b"".join(rows)))
    return b"\n".join([head, base64.encodebytes(data).strip(), tail, b""])


def told(call: Callable[[], object], kind: type[NetcfgError]) -> str:
    with pytest.raises(kind) as refused:
        call()
    whole = f"{refused.value!r} {refused.value} {refused.value.hint} {refused.value.__cause__!r}"
    assert "canary" not in whole
    assert RIGHT.reveal() not in whole
    return str(refused.value)


def test_a_passphrase_opens_what_it_sealed() -> None:
    assert sealed().startswith(b"-----BEGIN AGE ENCRYPTED FILE-----\n")
    assert pki.unseal(sealed(), RIGHT) == DATA


def test_wrong_passphrase_is_reported() -> None:
    assert told(lambda: pki.unseal(sealed(), WRONG), pki.WrongPassphrase) == "wrong passphrase, or the file was changed"


def test_changed_content_is_reported() -> None:
    changed = body(lambda data: data[:-1] + bytes([data[-1] ^ 1]))
    assert told(lambda: pki.unseal(changed, RIGHT), pki.CorruptSealError) == "the sealed file is truncated or damaged"


@pytest.mark.parametrize("keep", [0, 20, 100, -10])
def test_truncated_file_is_reported_before_scrypt_runs(keep: int) -> None:
    assert told(lambda: pki.unseal(sealed()[:keep], RIGHT), pki.CorruptSealError) == (
        "the sealed file is truncated or damaged"
    )


def test_file_for_a_key_cannot_be_opened_with_a_passphrase() -> None:
    other = pki.seal_for(DATA, str(IDENTITY.to_public()))
    assert "not a file that age sealed with a passphrase" in told(
        lambda: pki.unseal(other, RIGHT), pki.CorruptSealError
    )


@pytest.mark.parametrize("seal", [pki.seal, pki.vault_seal])
@pytest.mark.parametrize("short", ["", "canary"])
def test_short_passphrase_is_refused(seal: Callable[[bytes, Secret], bytes], short: str) -> None:
    assert ("too weak" if short else "is empty") in told(lambda: seal(DATA, Secret(short)), pki.WeakPassphrase)


@pytest.mark.parametrize(
    "weak",
    ["correct horse", "Passw0rd!Passw0rd!", "12345678901234567890", "qwertyuiop asdfghjkl", "canary-canary-canary-12"],
)
def test_long_but_guessable_passphrase_is_refused(weak: str) -> None:
    assert "guesses find it" in told(lambda: pki.check_passphrase(Secret(weak), pki.SEAL_GUESSES), pki.WeakPassphrase)


@pytest.mark.parametrize(
    "strong", ["mackerel lantern orbit velvet", "xK4-uW9-pQ2-rT7-mN", "vermelho barco cinco ondas " * 4]
)
def test_strong_passphrase_is_accepted(strong: str) -> None:
    pki.check_passphrase(Secret(strong), pki.VAULT_GUESSES)


def test_vault_requires_a_stronger_passphrase() -> None:
    """Its guesses are a thousand times cheaper."""
    middling = Secret("lantern velvet mackerel"[:18])
    pki.check_passphrase(middling, pki.SEAL_GUESSES)
    with pytest.raises(pki.WeakPassphrase, match=r"10\^16 are required"):
        pki.check_passphrase(middling, pki.VAULT_GUESSES)


def test_memory_needed_to_open_is_known_and_a_lack_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(STRENGTH, REAL)
    strong = pki.seal(DATA, RIGHT)
    needed = pki.opening_bytes(strong)
    assert needed == 256 << 20, "whatever the computer did meanwhile"
    memory = tmp_path / "meminfo"
    monkeypatch.setattr(sys.modules["atlantis_netcfg.vpn.pki.seal"], "_MEMORY", memory)
    memory.write_text(f"MemTotal: 99 kB\nMemAvailable:   {(needed >> 10) - 1} kB\n")
    for call, what in ((lambda: pki.unseal(strong, RIGHT), "opening"), (lambda: pki.seal(DATA, RIGHT), "sealing")):
        said = told(call, pki.SealTooLarge)
        assert said == f"{what} it needs 256 MiB of memory, but this computer has only 255 MiB free"
    for enough in (f"MemAvailable:   {needed >> 10} kB\n", "nothing of it"):
        memory.write_text(enough)
        assert pki.unseal(strong, RIGHT) == DATA
    assert pki.opening_bytes(pki.seal_for(DATA, str(IDENTITY.to_public()))) == 0


def test_a_recipient_opens_what_was_sealed_for_it() -> None:
    made = pki.seal_for(DATA, str(IDENTITY.to_public()))
    assert made.startswith(b"-----BEGIN AGE ENCRYPTED FILE-----\n")
    assert pki.unseal_with(made, Secret(f"{IDENTITY}\n")) == DATA
    other = Secret(str(pyrage.x25519.Identity.generate()))
    assert "another key" in told(lambda: pki.unseal_with(made, other), pki.WrongPassphrase)
    assert "truncated or damaged" in told(lambda: pki.unseal_with(made[:-60], other), pki.CorruptSealError)
    assert "not an age key" in told(lambda: pki.unseal_with(made, Secret("canary")), pki.InvalidRecipientError)


def test_each_of_several_recipients_can_open_it() -> None:
    others = [pyrage.x25519.Identity.generate() for _ in range(2)]
    made = pki.seal_for(DATA, *(str(one.to_public()) for one in others))
    assert [pki.unseal_with(made, Secret(str(one))) for one in others] == [DATA, DATA]


def test_an_ssh_key_opens_what_was_sealed_for_it() -> None:
    key = Ed25519PrivateKey.generate()
    public = key.public_key().public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH).decode()
    private = key.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption())
    made = pki.seal_for(DATA, f"{public} technician@quay")
    assert pyrage.decrypt(made, [pyrage.ssh.Identity.from_buffer(private)]) == DATA


@pytest.mark.parametrize(
    "text",
    [
        "",
        "age1",
        "age1" + "q" * 58,
        "AGE1" + "Q" * 58,
        str(IDENTITY.to_public()) + "\n",
        " " + str(IDENTITY.to_public()),
        "ssh-ed25519 AAAA",
        "ssh-dss AAAA",
        "-o ProxyCommand=x",
        "a\nssh-ed25519 AAAA",
    ],
    ids=["empty", "cut", "no-key", "capitals", "newline", "blank", "ssh-cut", "dss", "option", "two-lines"],
)
def test_invalid_recipient_is_reported(text: str) -> None:
    assert "not a recipient's key:" in told(lambda: pki.check_recipient(text), pki.InvalidRecipientError)


@pytest.mark.parametrize(
    "text",
    [str(IDENTITY), "-----BEGIN OPENSSH PRIVATE KEY-----\ncanary\n", f" {IDENTITY}".lower()],
    ids=["age", "ssh", "small letters"],
)
def test_a_secret_key_given_for_a_public_one_is_not_repeated(text: str) -> None:
    said = told(lambda: pki.check_recipient(text), pki.InvalidRecipientError)
    assert said == "this is a secret key; the recipient's public key is needed"


def test_long_invalid_recipient_is_shortened_in_the_message() -> None:
    said = told(lambda: pki.check_recipient("x" * 30 + "canary"), pki.InvalidRecipientError)
    assert said == f"not a recipient's key: '{'x' * 30}…'"


def test_vault_format_is_that_of_ansible() -> None:
    made = pki.vault_seal(DATA, RIGHT)
    assert made.startswith(b"$ANSIBLE_VAULT;1.1;AES256\n")
    assert pki.vault_unseal(made, RIGHT) == DATA
    assert "wrong passphrase, or the file was changed" in told(
        lambda: pki.vault_unseal(made, WRONG), pki.WrongPassphrase
    )
    assert "damaged" in told(lambda: pki.vault_unseal(made[:-20], RIGHT), pki.CorruptSealError)
    assert "not a file encrypted with ansible-vault" in told(
        lambda: pki.vault_unseal(b"x", RIGHT), pki.CorruptSealError
    )


def test_importing_the_package_does_not_start_ansible() -> None:
    code = "import sys, json, atlantis_netcfg.vpn.pki; print(json.dumps('ansible' in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) is False
