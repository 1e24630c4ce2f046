"""A device that does as a test's script says, over real TLS on loopback, with a codec of its own."""

import asyncio
import datetime as dt
import hashlib
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros.api import Endpoint

__all__ = ["PASSWORD", "Device", "Peer", "frame", "serving"]

PASSWORD = "correct horse"


def frame(*words: str | bytes) -> bytes:
    """Frame a sentence of short and middling words."""
    raw = [word.encode() if isinstance(word, str) else word for word in words]
    return b"".join(_size(len(word)) + word for word in raw) + b"\0"


def _size(size: int) -> bytes:
    return bytes([size]) if size < 0x80 else (size | 0x8000).to_bytes(2, "big")


class Peer:
    """The device's end of one connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    async def read(self) -> list[str]:
        """Read one sentence of words shorter than 16 kB."""
        words: list[str] = []
        while size := (await self.reader.readexactly(1))[0]:
            if size >= 0x80:
                size = (size & 0x3F) << 8 | (await self.reader.readexactly(1))[0]
            words.append((await self.reader.readexactly(size)).decode())
        return words

    async def read_tags(self, count: int) -> list[str]:
        """Read so many sentences, return their tags."""
        return [(await self.read())[-1].removeprefix(".tag=") for _ in range(count)]

    async def send(self, *sentences: tuple[str | bytes, ...]) -> None:
        """Send sentences in one write."""
        await self.raw(b"".join(frame(*sentence) for sentence in sentences))

    async def raw(self, data: bytes) -> None:
        """Send bytes as they are."""
        self.writer.write(data)
        await self.writer.drain()

    async def log_in(self) -> list[str]:
        """Let the client in, return its login sentence."""
        words = await self.read()
        await self.send(("!done", words[-1]))
        return words

    async def gone(self) -> bytes:
        """Wait until the client is gone, return what it still sent."""
        try:
            return await self.reader.read()
        except ConnectionError:
            return b""


class Device:
    """A listening device."""

    def __init__(self, port: int, fingerprint: str) -> None:
        self.port = port
        self.fingerprint = fingerprint

    def endpoint(
        self,
        *,
        pin: str | None = "",
        user: str = "provision",
        password: str = PASSWORD,
        connect_timeout_s: float = 20.0,
        reply_timeout_s: float = 20.0,
    ) -> Endpoint:
        """Return where it listens; by default the pin is right."""
        pinned = self.fingerprint if pin == "" else pin
        return Endpoint("127.0.0.1", self.port, user, Secret(password), pinned, connect_timeout_s, reply_timeout_s)


@asynccontextmanager
async def serving(
    folder: Path, script: Callable[[Peer], Awaitable[None]], *, context: ssl.SSLContext | None = None
) -> AsyncIterator[Device]:
    """Run `script` for every connection; what a script raises is raised here at the end."""
    runs: list[asyncio.Task[None]] = []

    async def run(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await script(Peer(reader, writer))
        finally:
            writer.transport.abort()

    def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        runs.append(asyncio.get_running_loop().create_task(run(reader, writer)))

    certificate = _certificate(folder)
    server = await asyncio.start_server(connected, "127.0.0.1", 0, ssl=context or _context(folder))
    try:
        yield Device(server.sockets[0].getsockname()[1], certificate)
        await asyncio.gather(*runs)
    finally:
        server.close()
        for task in runs:
            task.cancel()
        await asyncio.gather(*runs, return_exceptions=True)
        await server.wait_closed()


def _certificate(folder: Path) -> str:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "router")])
    start = dt.datetime(1970, 1, 2, tzinfo=dt.UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(start)
        .not_valid_after(start + dt.timedelta(days=1))
        .sign(key, hashes.SHA256())
    )
    (folder / "key.pem").write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    (folder / "certificate.pem").write_bytes(certificate.public_bytes(Encoding.PEM))
    return hashlib.sha256(certificate.public_bytes(Encoding.DER)).hexdigest()


def _context(folder: Path) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "certificate.pem", folder / "key.pem")
    return context
