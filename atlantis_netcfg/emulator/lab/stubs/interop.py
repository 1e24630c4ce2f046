"""A stub of the partners' interoperability library and examples, which are not public, and a git server."""

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
    from collections.abc import Iterator, Mapping
    from pathlib import Path


NOT_THEIRS = "a stand-in of the ATLANTIS toolkit, not the partners' library"
"""Notice in the output of the stub programs and in their sources."""

NOT_REHEARSED = (
    "the interoperability library: small placeholder projects are built instead, and communicate with nothing",
)
"""Limits of a rehearsal with stub packages."""

LIBRARY, EXAMPLES, MESSAGES = "uv-interoperability", "uv-interoperability-example", "c4i-asset-msgs"
_PACKAGE = """\
# {about}
cmake_minimum_required(VERSION 3.16)
project({name} CXX)
{body}
"""
_MESSAGES = {
    "CMakeLists.txt": _PACKAGE.format(
        about=NOT_THEIRS,
        name="c4i_asset_msgs",
        body="""\
add_library(c4i_asset_msgs INTERFACE)
target_include_directories(c4i_asset_msgs INTERFACE $<INSTALL_INTERFACE:include>)
install(DIRECTORY include/ DESTINATION include)
install(TARGETS c4i_asset_msgs EXPORT c4i_asset_msgsConfig)
install(EXPORT c4i_asset_msgsConfig DESTINATION lib/cmake/c4i_asset_msgs)""",
    ),
    "include/c4i_asset_msgs/stamped.hpp": """\
#pragma once
struct Stamped { double time_s; double value; };
""",
}
_LIBRARY = {
    "uv_interoperability/CMakeLists.txt": _PACKAGE.format(
        about=NOT_THEIRS,
        name="uv_interoperability",
        body="""\
find_package(c4i_asset_msgs REQUIRED)
add_library(uv_interoperability SHARED src/asset.cpp)
target_include_directories(uv_interoperability PUBLIC
  $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:include>)
target_link_libraries(uv_interoperability PUBLIC c4i_asset_msgs)
install(DIRECTORY include/ DESTINATION include)
install(TARGETS uv_interoperability EXPORT targets DESTINATION lib)
install(EXPORT targets DESTINATION lib/cmake/uv_interoperability)
install(FILES uv_interoperabilityConfig.cmake DESTINATION lib/cmake/uv_interoperability)""",
    ),
    "uv_interoperability/uv_interoperabilityConfig.cmake": """\
include(CMakeFindDependencyMacro)
find_dependency(c4i_asset_msgs)
include(${CMAKE_CURRENT_LIST_DIR}/targets.cmake)
""",
    "uv_interoperability/include/uv_interoperability/asset.hpp": """\
#pragma once
#include <c4i_asset_msgs/stamped.hpp>
const char *library_words();
Stamped telemetry(double value);
""",
}
_EXAMPLES = {
    "CMakeLists.txt": _PACKAGE.format(
        about=NOT_THEIRS,
        name="uv_interoperability_example",
        body="""\
include(more.cmake OPTIONAL)
find_package(uv_interoperability REQUIRED)
find_package(yaml-cpp REQUIRED)
add_executable(example-robot src/robot.cpp)
target_link_libraries(example-robot uv_interoperability yaml-cpp)""",
    ),
    "config/robot-config.yml": f"# {NOT_THEIRS}\nnamespace: TEST_ROBOT\nseconds: 3600\n",
    "src/robot.cpp": """\
#include <uv_interoperability/asset.hpp>
#include <yaml-cpp/yaml.h>
#include <cstdio>
#include <unistd.h>
int main(int count, char **words) {
  if (count < 2) { std::fprintf(stderr, "no configuration was named\\n"); return 2; }
  YAML::Node config = YAML::LoadFile(words[1]);
  std::printf("%s: %s\\n", config["namespace"].as<std::string>().c_str(), library_words());
  std::fflush(stdout);
  sleep(config["seconds"].as<unsigned>());
  return 0;
}
""",
}


def _asset_source(words: str) -> str:
    return f"""\
#include <uv_interoperability/asset.hpp>
const char *library_words() {{ return "{NOT_THEIRS}, {words}"; }}
Stamped telemetry(double value) {{ return {{0.0, value}}; }}
"""


@dataclass(frozen=True)
class InteropProjects:
    """Repositories in a folder for a git server, with the partners' own names.

    They have the structure that the toolkit must handle: a colcon workspace of two packages, one of them a submodule
    with the message definitions, and cmake examples that find the library and yaml-cpp. They exchange no data: the
    network behaviour of the partners' library is not rehearsed.
    """

    folder: Path

    def release(self, tag: str, words: str | None = None, *, submodule_at: str = "../c4i-asset-msgs.git") -> str:
        """Commit a release of the library under `tag`, moving an existing tag; return the commit.

        The library's programs print `words`: another text gives another commit.
        """
        messages = self._commit(MESSAGES, _MESSAGES, None)
        modules = f'[submodule "c4i-asset-msgs"]\n\tpath = c4i-asset-msgs\n\turl = {submodule_at}\n'
        files = {**_LIBRARY, "uv_interoperability/src/asset.cpp": _asset_source(words or tag), ".gitmodules": modules}
        return self._commit(LIBRARY, files, tag, {"c4i-asset-msgs": messages})

    def release_examples(self, tag: str, files: Mapping[str, str] | None = None) -> str:
        """Commit a release of the examples; `files` add to or replace the default files, `more.cmake` is included."""
        return self._commit(EXAMPLES, {**_EXAMPLES, **(files or {})}, tag)

    def branch(self, name: str) -> None:
        """Point a branch of the library at its last release."""
        self._git(LIBRARY, "branch", "--force", name, "main")

    def _commit(
        self, name: str, files: Mapping[str, str], tag: str | None, submodules: Mapping[str, str] | None = None
    ) -> str:
        """Write objects directly into the bare repository; the same files give the same commit."""
        repository = self.folder / f"{name}.git"
        if not repository.is_dir():
            repository.mkdir(parents=True)
            self._git(name, "init", "--quiet", "--bare", "-b", "main")
        index = repository / "index.new"
        entries = [
            f"100644 {self._git(name, 'hash-object', '-w', '--stdin', text=text)}\t{path}"
            for path, text in files.items()
        ]
        entries += [f"160000 {commit}\t{path}" for path, commit in (submodules or {}).items()]
        self._git(name, "update-index", "--index-info", text="\n".join([*entries, ""]), index=index)
        tree = self._git(name, "write-tree", index=index)
        index.unlink()
        before = self._git(name, "for-each-ref", "--format=%(objectname)", "refs/heads/main")
        if before and self._git(name, "rev-parse", f"{before}^{{tree}}") == tree:
            commit = before
        else:
            commit = self._git(name, "commit-tree", tree, *(("-p", before) if before else ()), "-m", NOT_THEIRS)
        self._git(name, "update-ref", "refs/heads/main", commit)
        if tag is not None:
            self._git(name, "tag", "--force", tag, commit)
        return commit

    def _git(self, name: str, *words: str, text: str = "", index: Path | None = None) -> str:
        who = {"GIT_AUTHOR_NAME": "stand-in", "GIT_AUTHOR_EMAIL": "stand-in@example.org"}
        who |= {key.replace("AUTHOR", "COMMITTER"): value for key, value in who.items()}
        where = {"GIT_DIR": str(self.folder / f"{name}.git"), **({"GIT_INDEX_FILE": str(index)} if index else {})}
        process = subprocess.run(  # noqa: S603 - git, with words of ours
            ("git", *words),  # noqa: S607
            input=text,
            env={**os.environ, **who, **where},
            capture_output=True,
            text=True,
            check=True,
        )
        return process.stdout.strip()


def make_interop(folder: Path, tag: str) -> InteropProjects:
    """Make the repositories below `folder`, each with one release."""
    projects = InteropProjects(folder)
    projects.release(tag)
    projects.release_examples(tag)
    return projects


_BACKEND = ("git", "http-backend")


@dataclass
class GitServer:
    """A git server's settings; `token` may be changed while it runs, None allows anonymous reading.

    It behaves like a public forge: smart HTTP, shallow fetches, commits by hash, and the same error for a wrong token
    and a missing repository.
    """

    folder: Path
    token: str | None
    url: str = ""
    requests: list[str] = field(default_factory=list)
    """Method and path of every request, with a prefix if it had a token."""
    sent_bytes: int = 0
    """Bytes of responses, without headers."""

    def admits(self, authorization: str) -> bool:
        """Return whether the Authorization header (RFC 7617) has the token."""
        if self.token is None:
            return True
        text = base64.b64decode(authorization.partition(" ")[2] or "", validate=False).decode(errors="replace")
        return hmac.compare_digest(text.partition(":")[2].encode(), self.token.encode())


@contextmanager
def serve_git(
    folder: Path, listener: socket.socket, token: str | None = None, tls: ssl.SSLContext | None = None
) -> Iterator[GitServer]:
    """Serve the bare repositories below `folder` on a socket until the block ends; HTTPS if `tls` is given."""
    git_server = GitServer(folder, token)
    host, port = listener.getsockname()[:2]
    git_server.url = f"{'http' if tls is None else 'https'}://{host}:{port}"
    handler = type("_Handler", (_GitHandler,), {"git": git_server})
    server = ThreadingHTTPServer((host, port), handler, bind_and_activate=False)
    server.socket.close()
    # Handshakes are made where a request is read, so that a client which trusts nobody stops no other.
    server.socket = (
        listener if tls is None else tls.wrap_socket(listener, server_side=True, do_handshake_on_connect=False)
    )
    thread = threading.Thread(target=server.serve_forever, name="git-server", daemon=True)
    thread.start()
    try:
        yield git_server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class _GitHandler(BaseHTTPRequestHandler):
    """One connection; `git http-backend` is a CGI program (RFC 3875)."""

    git: GitServer
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """Return references."""
        self._answer(b"")

    def do_POST(self) -> None:
        """Send objects."""
        self._answer(self.rfile.read(int(self.headers.get("Content-Length", "0"))))

    def handle_one_request(self) -> None:
        """Handle a request; a client that disconnects or rejects the certificate is no error."""
        try:
            super().handle_one_request()
        except OSError:
            self.close_connection = True

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the class above has it
        """Ignore log messages: `GitServer` keeps the requests."""

    def _answer(self, body: bytes) -> None:
        authorization = self.headers.get("Authorization", "")
        self.git.requests.append(f"{'with a token ' if authorization else ''}{self.command} {self.path}")
        if not self.git.admits(authorization):
            asks = (("WWW-Authenticate", 'Basic realm="stand-in"'),)
            self._send(HTTPStatus.UNAUTHORIZED, asks, b"HTTP Basic: Access denied\n")
            return
        process = subprocess.run(  # noqa: S603 - git, for requests of machines of ours
            _BACKEND, input=body, env=self._variables(len(body)), capture_output=True, check=False
        )
        head, _, answer = process.stdout.partition(b"\r\n\r\n")
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
        self.git.sent_bytes += len(body)
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
