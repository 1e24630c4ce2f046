"""The VPN in work: what the commands do with its authority, and how its server is asked and told.

Every change is recorded by the authority before the server hears of it, so that a server that cannot be reached delays
a change and never loses it. What the server has is compared with the record each time, not remembered.
"""
