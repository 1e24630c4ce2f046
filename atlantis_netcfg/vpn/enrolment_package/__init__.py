"""The one file that a member gets: its profile, its page of instructions and its self-test, sealed for it alone.

The content is a pure function of the declaration, the identity and the contact: page, profile and test cannot disagree.
It exists in memory only until it is sealed: no step writes a secret to a disk. The same package reads it back
(`accept`), so that a declared host takes the same path as every partner.
"""
