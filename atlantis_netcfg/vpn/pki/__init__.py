"""Keys, certificates, the revocation list, and the seals of files: all as values in memory, made by libraries.

Nothing here keeps anything: who calls decides what is written, after it stands in the ledger. Only a revocation list is
also put in its place here, because OpenVPN fails open on one that is laid carelessly. What a signature must not be put
under (a name that OpenVPN misreads, a certificate that outlives its CA) is refused here too, whoever asks.
"""

from __future__ import annotations

from atlantis_netcfg.vpn.pki._errors import (
    CertificateRefused,
    CrlRefused,
    KeyDamaged,
    RecipientRefused,
    SealDamaged,
    SealTooLarge,
    WeakPassphrase,
    WrongPassphrase,
)
from atlantis_netcfg.vpn.pki.certificates import (
    CA_DAYS,
    SERVER_DAYS,
    Ca,
    cert_pem,
    issued_by,
    load_ca,
    load_cert,
    new_ca,
    new_client,
    new_serial,
    new_server,
    sha256,
)
from atlantis_netcfg.vpn.pki.crl import CRL_DAYS, CrlFacts, RevokedSerial, check_crl, new_crl, publish, read_crl
from atlantis_netcfg.vpn.pki.keys import PrivateKey, PublicKey, is_signed, key_pem, load_key, new_key, sign
from atlantis_netcfg.vpn.pki.seal import (
    SEAL_GUESSES,
    VAULT_GUESSES,
    check_passphrase,
    check_recipient,
    opening_bytes,
    seal,
    seal_for,
    unseal,
    unseal_with,
    vault_seal,
    vault_unseal,
)
from atlantis_netcfg.vpn.pki.tls_crypt import METADATA_MAX, client_key, server_key, shared_key

__all__ = [
    "CA_DAYS",
    "CRL_DAYS",
    "METADATA_MAX",
    "SEAL_GUESSES",
    "SERVER_DAYS",
    "VAULT_GUESSES",
    "Ca",
    "CertificateRefused",
    "CrlFacts",
    "CrlRefused",
    "KeyDamaged",
    "PrivateKey",
    "PublicKey",
    "RecipientRefused",
    "RevokedSerial",
    "SealDamaged",
    "SealTooLarge",
    "WeakPassphrase",
    "WrongPassphrase",
    "cert_pem",
    "check_crl",
    "check_passphrase",
    "check_recipient",
    "client_key",
    "is_signed",
    "issued_by",
    "key_pem",
    "load_ca",
    "load_cert",
    "load_key",
    "new_ca",
    "new_client",
    "new_crl",
    "new_key",
    "new_serial",
    "new_server",
    "opening_bytes",
    "publish",
    "read_crl",
    "seal",
    "seal_for",
    "server_key",
    "sha256",
    "shared_key",
    "sign",
    "unseal",
    "unseal_with",
    "vault_seal",
    "vault_unseal",
]
