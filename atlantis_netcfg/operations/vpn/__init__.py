"""The VPN at work: what the commands do with its authority, and how its server is observed and changed.

Every change is recorded by the authority before the server gets it. A server that cannot be reached therefore delays a
change and never loses it. What the server has is compared with the record each time, not remembered.
"""
