"""The VPN that joins sites, robots and partners: its authority, its server, and what its members are handed.

The authority is a folder of the operator: a sealed CA key and an append-only ledger, in which everything stands before
it leaves. From the declaration and the ledger's roll of members all else follows by pure functions: the server's files,
its firewall, its list of revoked certificates, a member's profile. What is deployed is therefore compared, not tracked.

    names.py      which names are taken at all
    identity.py   members, their certificates, the roll
    pki/          keys, certificates, revocation list, tls-crypt keys, the sealed CA key: no files but by its callers
    ledger/       the append-only file, and the roll that is read from it
    authority/    the folder: locks, transactions, what a killed command left
    policy.py     who may reach whom, as a matrix; firewall.py the same in nftables' words
    server.py     what the server's computer holds; client.py the same of a gateway
    handout/      the one file that a member gets, sealed, with its page of instructions and its self-test
"""
