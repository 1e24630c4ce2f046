"""Stub, not a partner's program: listens on a service's port, and says so to each client."""

# ruff: noqa: INP001 - a file of a rehearsed computer, no module of ours

import socket
import time

HELLO = b"stand-in of a rehearsal\n"


def serve(kind: str, port: int) -> None:
    """Serve for ever. `kind` is tcp or udp; port 0: only run."""
    if not port:
        while True:
            time.sleep(3600)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind(("", port))
        if kind == "tcp":
            server.listen()
        while True:
            if kind == "tcp":
                guest, _ = server.accept()
                with guest:
                    guest.sendall(HELLO)
            else:
                _, address = server.recvfrom(2048)
                server.sendto(HELLO, address)
