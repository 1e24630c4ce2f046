"""The authority's folder: what is issued, renewed and revoked there is recorded before it leaves.

One process at a time writes, under a lock that the kernel frees. Each command is a transaction of the ledger: what a
killed one left is finished or withdrawn by the next, so that repeating the command is always the way on. Files beside
the ledger are copies of what it says, or are made out anew from it.

    with Authority.open(folder).unlocked(passphrase, who) as signer:
        signer.issue([Wish(...)], deliver)
"""

from __future__ import annotations

from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.check import Agreement
from atlantis_netcfg.vpn.authority.ledger_session import NONE_SIGNED
from atlantis_netcfg.vpn.authority.model import (
    CLIENT_DAYS,
    AddressTaken,
    AuthorityBusy,
    AuthorityDamaged,
    AuthorityFailed,
    ClockBehind,
    EnrolmentRequest,
    HandoutFile,
    IssueResult,
    NoAuthority,
    NoSuchMember,
    OtherMember,
    PoolFull,
    RenewalRequest,
    RevocationResult,
    ServerNames,
    SessionObservation,
)
from atlantis_netcfg.vpn.authority.signer import Signer
from atlantis_netcfg.vpn.ledger import Entry
from atlantis_netcfg.vpn.names import NameRefused, NameTaken

__all__ = [
    "CLIENT_DAYS",
    "NONE_SIGNED",
    "AddressTaken",
    "Agreement",
    "Authority",
    "AuthorityBusy",
    "AuthorityDamaged",
    "AuthorityFailed",
    "ClockBehind",
    "EnrolmentRequest",
    "Entry",
    "HandoutFile",
    "IssueResult",
    "NameRefused",
    "NameTaken",
    "NoAuthority",
    "NoSuchMember",
    "OtherMember",
    "PoolFull",
    "RenewalRequest",
    "RevocationResult",
    "ServerNames",
    "SessionObservation",
    "Signer",
]
