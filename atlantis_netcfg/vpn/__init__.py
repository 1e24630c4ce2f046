"""The VPN that joins sites, robots and partners: its authority, its server, and what its members get.

The authority is a folder of the operator: a sealed CA key and an append-only ledger. Everything is recorded there
before it leaves. All else follows from the declaration and the ledger by pure functions: the server's files, its
firewall, its revocation list, a member's profile. What is deployed is therefore compared, not tracked.

    names.py              which names are allowed
    identity.py           members, their certificates, the list of members
    systems.py            what a partner's device runs, and which key its OpenVPN can read
    pki/                  keys, certificates, revocation list, tls-crypt keys, the sealed CA key
    ledger/               the append-only file, and the list of members that is read from it
    authority/            the folder: lock, transactions, recovery after a killed command
    policy.py             who may reach whom, as a matrix; firewall.py: the same in the language of nftables
    server.py             what the server's computer holds; client.py: the same for a gateway
    routeros.py           a RouterOS router as a member
    enrolment_package/    the one sealed file that a member gets, with its instructions, its self-test and its
                          DDS files, and the cover note beside it
"""
