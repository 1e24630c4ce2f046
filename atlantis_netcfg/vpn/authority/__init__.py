"""The authority's folder: everything issued, renewed and revoked is recorded before it is handed out.

One process at a time writes, under a lock that the kernel releases. Each command is a transaction of the ledger: what a
killed one left is completed or withdrawn by the next, so repeating the command is always safe. Files beside the ledger
are copies of its content, or are created again from it.

    with Authority.open(folder).unlock(passphrase, who) as signer:
        signer.issue([EnrolmentRequest(...)], deliver)
"""
