"""The router at the far end of a laptop's cable: it completes handshakes, and tells what it is told.

It imports nothing of ours: it is started for each test.
"""

import socket
import ssl
import sys


def serve(pem: str, address: str, port: int) -> None:
    """Complete handshakes, and print what is said after each: a line a connection."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(pem)
    with socket.create_server((address, port)) as listening:
        sys.stdout.write("listens\n")
        sys.stdout.flush()
        while True:
            connection, _ = listening.accept()
            with connection, context.wrap_socket(connection, server_side=True) as session:
                try:
                    said = session.recv(4096)
                except (ssl.SSLError, OSError):
                    said = b""
            sys.stdout.write(f"said {said!r}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    serve(sys.argv[1], sys.argv[2], int(sys.argv[3]))
