"""The authority's folder: what is issued, renewed and revoked there is recorded before it leaves.

One process at a time writes, under a lock that the kernel frees. Each command is a transaction of the ledger: what a
killed one left is finished or withdrawn by the next, so that repeating the command is always the way on. Files beside
the ledger are copies of what it says, or are made out anew from it.

    with Authority.open(folder).unlocked(passphrase, who) as signer:
        signer.issue([EnrolmentRequest(...)], deliver)
"""
