"""A git server for machines: `git http-backend` behind a small HTTP server that asks for a token.

It gives what a forge gives: smart HTTP, shallow fetches, commits by their name, and one word for a token that is wrong
and for a repository that is not there.
"""

from __future__ import annotations

import base64
import hmac
import os
import subprocess
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    import socket
    import ssl
    from collections.abc import Iterator
    from pathlib import Path

_BACKEND = ("git", "http-backend")


@dataclass
class GitServer:
    """What it serves; `token` may be changed while it runs, None lets everybody read."""

    folder: Path
    token: str | None
    url: str = ""
    requests: list[str] = field(default_factory=list)
    """Method and path of every request, with the name that was told in front where there was one."""
    sent: int = 0
    """Bytes of answers, without their headers."""

    def admits(self, authorization: str) -> bool:
        """Whether what was told (RFC 7617) holds the token."""
        if self.token is None:
            return True
        text = base64.b64decode(authorization.partition(" ")[2] or "", validate=False).decode(errors="replace")
        return hmac.compare_digest(text.partition(":")[2].encode(), self.token.encode())


@contextmanager
def serve_git(
    folder: Path, listener: socket.socket, token: str | None = None, tls: ssl.SSLContext | None = None
) -> Iterator[GitServer]:
    """Serve the bare repositories below `folder` on a listening socket, by HTTPS with `tls`, until the block ends."""
    made = GitServer(folder, token)
    host, port = listener.getsockname()[:2]
    made.url = f"{'http' if tls is None else 'https'}://{host}:{port}"
    handler = type("_Handler", (_Git,), {"git": made})
    server = ThreadingHTTPServer((host, port), handler, bind_and_activate=False)
    server.socket.close()
    # Handshakes are made where a request is read, so that a client which trusts nobody stops no other.
    server.socket = (
        listener if tls is None else tls.wrap_socket(listener, server_side=True, do_handshake_on_connect=False)
    )
    thread = threading.Thread(target=server.serve_forever, name="git-server", daemon=True)
    thread.start()
    try:
        yield made
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class _Git(BaseHTTPRequestHandler):
    """One connection; `git http-backend` is a CGI program (RFC 3875)."""

    git: GitServer
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """Tell references."""
        self._answer(b"")

    def do_POST(self) -> None:
        """Send objects."""
        self._answer(self.rfile.read(int(self.headers.get("Content-Length", "0"))))

    def handle_one_request(self) -> None:
        """Read a request; who leaves in the middle, or does not trust the certificate, is no error of ours."""
        try:
            super().handle_one_request()
        except OSError:
            self.close_connection = True

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the class above has it
        """Requests are kept by `GitServer`."""

    def _answer(self, body: bytes) -> None:
        authorization = self.headers.get("Authorization", "")
        self.git.requests.append(f"{'with a token ' if authorization else ''}{self.command} {self.path}")
        if not self.git.admits(authorization):
            asks = (("WWW-Authenticate", 'Basic realm="stand-in"'),)
            self._send(HTTPStatus.UNAUTHORIZED, asks, b"HTTP Basic: Access denied\n")
            return
        done = subprocess.run(  # noqa: S603 - git, for requests of machines of ours
            _BACKEND, input=body, env=self._variables(len(body)), capture_output=True, check=False
        )
        head, _, answer = done.stdout.partition(b"\r\n\r\n")
        headers = tuple(
            (name, value) for name, _, value in (line.partition(": ") for line in head.decode().split("\r\n"))
        )
        status = int(dict(headers).get("Status", "200").split()[0])
        self._send(HTTPStatus(status), tuple(header for header in headers if header[0] not in ("Status", "")), answer)

    def _variables(self, length: int) -> dict[str, str]:
        parts = urlsplit(self.path)
        return {
            "PATH": os.environ["PATH"],
            "GIT_PROJECT_ROOT": str(self.git.folder),
            "GIT_HTTP_EXPORT_ALL": "1",
            "GIT_CONFIG_COUNT": "1",
            "GIT_CONFIG_KEY_0": "safe.directory",
            "GIT_CONFIG_VALUE_0": "*",
            "PATH_INFO": parts.path,
            "QUERY_STRING": parts.query,
            "REQUEST_METHOD": self.command,
            "REMOTE_ADDR": self.client_address[0],
            "CONTENT_TYPE": self.headers.get("Content-Type", ""),
            "CONTENT_LENGTH": str(length),
            "HTTP_CONTENT_ENCODING": self.headers.get("Content-Encoding", ""),
            "GIT_PROTOCOL": self.headers.get("Git-Protocol", ""),
        }

    def _send(self, status: HTTPStatus, headers: tuple[tuple[str, str], ...], body: bytes) -> None:
        self.git.sent += len(body)
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
