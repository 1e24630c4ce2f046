"""Private keys: made in memory, and written by whoever is told to keep them."""

from __future__ import annotations

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec, padding, rsa
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn.identity import KeyType
from atlantis_netcfg.vpn.pki._errors import KeyDamaged

__all__ = ["PrivateKey", "PublicKey", "is_signed", "key_pem", "load_key", "new_key", "sign"]

PrivateKey = ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey
PublicKey = ec.EllipticCurvePublicKey | rsa.RSAPublicKey


def new_key(kind: KeyType) -> PrivateKey:
    """EC P-256, or RSA of 2048 bits: what every client that we know of can use (facts 10)."""
    if kind is KeyType.EC:
        return ec.generate_private_key(ec.SECP256R1())
    return rsa.generate_private_key(public_exponent=65537, key_size=2048)


def key_pem(key: PrivateKey) -> Secret:
    """PKCS #8, not encrypted: an OpenVPN that starts with the computer has nobody to ask for a passphrase."""
    return Secret(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode("ascii"))


def sign(key: PrivateKey, text: bytes) -> bytes:
    """Sign a text of ours, which must begin with words that say what it is: a CA key also signs certificates."""
    if isinstance(key, rsa.RSAPrivateKey):
        return key.sign(text, padding.PKCS1v15(), SHA256())
    return key.sign(text, ec.ECDSA(SHA256()))


def is_signed(key: PublicKey, text: bytes, signature: bytes) -> bool:
    """Whether the holder of the private half has signed that text."""
    try:
        if isinstance(key, rsa.RSAPublicKey):
            key.verify(signature, text, padding.PKCS1v15(), SHA256())
        else:
            key.verify(signature, text, ec.ECDSA(SHA256()))
    except InvalidSignature:
        return False
    return True


def load_key(pem: Secret) -> PrivateKey:
    """The key of such a text. Raises KeyDamaged; what the text held is in no message."""
    try:
        key = load_pem_private_key(pem.reveal().encode(), password=None)
    except (ValueError, TypeError):
        key = None
    if not isinstance(key, PrivateKey):
        raise KeyDamaged("this is no private key of ours", hint="restore the file from your backup of the authority")
    return key
