"""A headless Chromium that is spoken to through a pipe (DevTools protocol), so that one start serves every look."""

import base64
import fcntl
import http.server
import json
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

FLAGS = (
    "--headless",
    "--no-sandbox",  # tests run as root, where Chromium has no other choice
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--no-first-run",
    "--no-default-browser-check",
    "--metrics-recording-only",
    "--hide-scrollbars",
    "--force-color-profile=srgb",
    "--remote-debugging-pipe",
)


class Counting:
    """A proxy that passes nothing on and remembers what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        asked = self.asked

        class Handler(http.server.BaseHTTPRequestHandler):
            def _refuse(self) -> None:
                asked.append(self.requestline)
                with suppress(OSError):  # it may have hung up
                    self.send_error(403)

            def __getattr__(self, name: str) -> Callable[[], None]:
                if name.startswith("do_"):
                    return self._refuse
                raise AttributeError(name)

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - named by the standard library
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.05})

    def __enter__(self) -> Self:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


class Chromium:
    """A tab of it."""

    def __init__(self, to: int, back: int, proxy: Counting) -> None:
        self.proxy = proxy
        self._to, self._back = to, back
        self._rest = b""
        self._last = 0
        self._session: str | None = None
        self.events: list[dict[str, Any]] = []
        target = self("Target.createTarget", url="about:blank")["targetId"]
        self._session = self("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self(f"{domain}.enable")

    def __call__(self, method: str, **params: Any) -> Any:  # noqa: ANN401 - JSON of the protocol
        self._last += 1
        said: dict[str, Any] = {"id": self._last, "method": method, "params": params}
        if self._session is not None:
            said["sessionId"] = self._session
        os.write(self._to, json.dumps(said).encode() + b"\0")
        while True:
            heard = self._hear()
            if heard.get("id") == self._last:
                assert "error" not in heard, (method, heard["error"])
                return heard["result"]
            self.events.append(heard)

    def _hear(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            more = os.read(self._back, 1 << 20)
            assert more, "Chromium has gone"
            self._rest += more
        one, _, self._rest = self._rest.partition(b"\0")
        told: dict[str, Any] = json.loads(one)
        return told

    def open(self, page: Path, *, width: int, height: int, dark: bool = False, media: str = "screen") -> None:
        """Load a page as a screen of so many pixels shows it; returns when all of it is there."""
        self("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600)
        self.look(dark=dark, media=media)
        self.events.clear()
        self("Page.navigate", url=page.as_uri())
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._hear())

    def look(self, *, dark: bool = False, media: str = "screen") -> None:
        """As somebody who likes it dark, or as a printer."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self("Emulation.setEmulatedMedia", media=media, features=[scheme])

    def run(self, script: str) -> Any:  # noqa: ANN401 - JSON of the page
        """The value of an expression in the page; a promise is waited for."""
        told = self("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def requests(self) -> list[str]:
        """Addresses that the page has asked for since it was opened."""
        sent = (event["params"] for event in self.events if event.get("method") == "Network.requestWillBeSent")
        return [params["request"]["url"] for params in sent]

    def picture(self, to: Path) -> None:
        """All of the page, for people."""
        told = self("Page.captureScreenshot", captureBeyondViewport=True, format="png")
        to.write_bytes(base64.b64decode(told["data"]))

    def printed(self, to: Path) -> None:
        """As a printer gets it."""
        told = self("Page.printToPDF", preferCSSPageSize=True, printBackground=False)
        to.write_bytes(base64.b64decode(told["data"]))


@contextmanager
def chromium(profile: Path) -> Iterator[Chromium]:
    """Start it; whatever it asks for beyond the file that it shows, a counting proxy refuses."""
    ask, say = os.pipe()
    hear, answer = os.pipe()
    with Counting() as proxy:
        proxied = f"--proxy-server=http://127.0.0.1:{proxy.server.server_port}"
        # Without this even names and addresses of this machine would go past the proxy.
        words = [*FLAGS, proxied, "--proxy-bypass-list=<-loopback>", f"--user-data-dir={profile}"]
        process = _started(words, ask, answer)
        try:
            yield Chromium(say, hear, proxy)
        finally:
            os.close(say)
            os.kill(process, signal.SIGTERM)
            os.waitpid(process, 0)
            os.close(hear)


def _started(words: Sequence[str], ask: int, answer: int) -> int:
    """It reads what it is told from its file 3 and answers on its file 4."""
    # Out of the way first: one of them may be 3 or 4 here.
    high = [fcntl.fcntl(one, fcntl.F_DUPFD_CLOEXEC, 20) for one in (ask, answer)]
    quiet = [(os.POSIX_SPAWN_OPEN, one, os.devnull, os.O_RDWR, 0) for one in (0, 1, 2)]
    moved = [(os.POSIX_SPAWN_DUP2, one, number) for one, number in zip(high, (3, 4), strict=True)]
    process = os.posix_spawnp("chromium", ["chromium", *words], os.environ, file_actions=[*quiet, *moved])
    for one in (*high, ask, answer):
        os.close(one)
    return process
