"""VPN operations: the commands' use of the authority, and reading and changing the server.

The authority records every change before the server gets it. A server that cannot be reached therefore delays a change
and never loses it. The server's state is compared with the record each time, not remembered.
"""
