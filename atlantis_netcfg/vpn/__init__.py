"""The VPN that connects sites, robots and partners: its authority, its server, and the members' packages.

The authority is a folder of the operator: a sealed CA key and an append-only ledger. Everything is recorded there
before it is handed out. All else is computed from inventory and ledger by pure functions: the server's files, its
firewall, its revocation list, a member's profile. Therefore the deployed state is compared, not tracked.

    names.py              allowed names
    identity.py           members, their certificates, the list of members
    systems.py            the system of a partner's device, and the key that its OpenVPN can read
    pki/                  keys, certificates, revocation list, tls-crypt keys, the sealed CA key
    ledger/               the append-only file, and the list of members read from it
    authority/            the folder: lock, transactions, recovery after a killed command
    policy.py             access policy as a matrix; firewall.py: the same as nftables rules
    server.py             files on the server's computer; client.py: the same for a gateway
    routeros.py           a RouterOS router as a member
    enrolment_package/    the one sealed file for a member, with its instructions, its self-test and its
                          DDS files, and the cover note beside it
"""
