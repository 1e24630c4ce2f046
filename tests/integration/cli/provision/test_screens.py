"""What a person sees at the end of a command: the screen of a terminal of 80 columns and 24 lines, in both languages.

Every screen is that of a real run. Its last eight lines alone have to tell what happened and what to do.
"""

import os
import re
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import preforked
import pytest
from quay import ADDRESS, PROVISION, ROUTER, Quay, quay
from terminal import Terminal, terminal
from test_real_run import await_record
from test_stopped_runs import children
from waiting import HANG_S

from atlantis_netcfg.emulator.routeros import DeviceMode, DeviceModeName

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
GOLDEN = Path(__file__).with_name("golden") / "screens"
REWRITE = "ATLANTIS_WRITE_SCREENS"
"""Set it to write the screens anew, then look at what has changed."""
LANGUAGES = ("en", "pt")
VERDICTS = ("[OK] ", "[!] ", "[~] ", "[?] ", "[FAIL] ", "X FAIL")
SITE = ("site=coastal", f"device={ROUTER}", "inventory=inventory")
SENT = '"kind":"layer-sent"'


@dataclass(frozen=True)
class Situation:
    """How a command comes to its end."""

    code: int
    typed: tuple[str, ...]
    prepare: Callable[[Quay], None] = lambda _at: None


def protect_nothing(at: Quay) -> None:
    at.replace("old", version="7.17.1", device_mode=DeviceMode(mode=DeviceModeName.HOME))
    at.adopt()


def drop_in_the_middle(at: Quay) -> None:
    """The connection breaks after the first layer; the router is there again at once."""
    at.do("link", delay_s=0.1)

    def drop() -> None:
        await_record(at.state, SENT)
        at.do("drop")

    threading.Thread(target=drop, daemon=True).start()


def unplug(_at: Quay) -> None:
    """The laptop has no way to the router any more."""
    subprocess.run(["ip", "address", "del", f"{ADDRESS[0]}/32", "dev", "lo"], check=True)


SITUATIONS = {
    "all-well": Situation(0, (*SITE, "--yes")),
    "one-warning": Situation(0, ("site=coastal", f"device={ROUTER},coastal-sat", "inventory=inventory", "--yes")),
    "refused": Situation(4, (*SITE, "--yes"), protect_nothing),
    "rolled-back": Situation(4, (*SITE, "--yes"), drop_in_the_middle),
    "not-reached": Situation(4, (*SITE, "--yes"), unplug),
    "plan": Situation(2, ("plan", *SITE, "--summary")),
    "rehearsal": Situation(0, ("site=coastal", f"device={ROUTER}", "--rehearse")),
}


LEFT_OUT = {"ATLANTIS_STATE", "NO_COLOR", "LC_ALL", "LC_CTYPE", "LANG", "PAGER", "COLUMNS", "LINES"}
"""What the person who runs the tests has set, and a person at this terminal has not."""


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    with quay(tmp_path) as opened:
        (tmp_path / ".local" / "state").mkdir(parents=True)
        (tmp_path / "state").mkdir(exist_ok=True)
        (tmp_path / ".local" / "state" / "atlantis").symlink_to(tmp_path / "state")
        yield opened


def environment(at: Quay, **more: str) -> dict[str, str]:
    """Of a person at a terminal: nothing of the test's own paths is told."""
    kept = {name: value for name, value in at.environment().items() if name not in LEFT_OUT}
    person = {"HOME": str(at.inventory.parent), "LANG": "C.UTF-8", "TERM": "xterm-256color", "PAGER": "cat"}
    return {**kept, **person, **more}


def run(at: Quay, situation: Situation, *more: str, columns: int = 80, **env: str) -> Terminal:
    """Type it, and wait for its end."""
    situation.prepare(at)
    with terminal(columns) as seen:
        words = [*situation.typed, *more]
        folder = at.inventory.parent
        process = preforked.start(words, environment(at, **env), seen.descriptor, folder)
        code = process.wait(HANG_S)
    assert code == situation.code, seen.lines
    return seen


def struck(at: Quay, name: str, *more: str, columns: int = 80, **env: str) -> Terminal:
    """The program itself, on its terminal; something strikes it after the first layer was sent."""
    code, strike = STRUCK[name]
    at.do("link", delay_s=0.15)
    with terminal(columns) as seen:
        process = subprocess.Popen(
            [PROVISION, *SITE, "--yes", *more],
            env=environment(at, **env),
            cwd=at.inventory.parent,
            stdin=seen.descriptor,
            stdout=seen.descriptor,
            stderr=seen.descriptor,
            start_new_session=True,
        )
        await_record(at.state, SENT)
        strike(process.pid)
        found = process.wait(HANG_S)
    assert found == code, seen.lines
    return seen


def interrupt(pid: int) -> None:
    os.kill(pid, signal.SIGINT)


def kill_the_task(pid: int) -> None:
    for task in children(pid):
        os.kill(task, signal.SIGKILL)


STRUCK = {"interrupted": (4, interrupt), "unknown": (5, kill_the_task)}


CHECK = ("check", "site=coastal", "vehicle=eca-rov", "endpoint=ethernet", "--rehearse", "break=cable-out")
SIGNS = {"en": "on\nyes\nA. Technician\n", "pt": "continuar\nsim\nA. Technician\n"}


def checked(folder: Path, language: str, columns: int = 80, **env: str) -> Terminal:
    """A checklist with an item that fails, gone through and signed by a person."""
    person = {"HOME": str(folder), "LANG": "C.UTF-8", "TERM": "xterm-256color", **env}
    kept = {name: value for name, value in os.environ.items() if name not in LEFT_OUT}
    with terminal(columns) as seen:
        seen.press(SIGNS[language])
        process = preforked.start([*CHECK, "--lang", language], {**kept, **person}, seen.descriptor, folder)
        code = process.wait(HANG_S)
    assert code == 6, seen.lines
    return seen


def hold(name: str, language: str, shown: Sequence[str]) -> None:
    """Compare with the golden screen."""
    file = GOLDEN / f"{name}.{language}.txt"
    text = "\n".join(shown).rstrip("\n") + "\n"
    if REWRITE in os.environ:
        file.write_text(text, encoding="utf-8")
    assert text == file.read_text(encoding="utf-8"), text


def hold_enough(last: Sequence[str]) -> None:
    """Whoever sees these lines alone knows the verdict, and what to do."""
    assert any(line.startswith(VERDICTS) for line in last), last
    starts = {line[:10].strip() for line in last} | {line[:4].strip() for line in last}
    assert starts & {"do", "next", "fazer", "a seguir"} or any("provision check" in line for line in last), last


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", SITUATIONS)
def test_the_screen_of_a_run(at: Quay, name: str, language: str) -> None:
    seen = run(at, SITUATIONS[name], "--lang", language)
    hold_enough(seen.last)
    hold(name, language, seen.shown)


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", STRUCK)
def test_screen_of_an_interrupted_run(at: Quay, name: str, language: str) -> None:
    seen = struck(at, name, "--lang", language)
    hold_enough(seen.last)
    hold(name, language, seen.shown)


@pytest.mark.parametrize("language", LANGUAGES)
def test_screen_of_a_failed_checklist(tmp_path: Path, language: str) -> None:
    seen = checked(tmp_path, language)
    hold_enough(seen.last)
    hold("checklist-failed", language, seen.shown)


@pytest.mark.parametrize(
    ("name", "language"),
    [
        pytest.param(name, language, marks=[] if (row + column) % 2 == 0 else [pytest.mark.campaign])
        for row, name in enumerate([*SITUATIONS, *STRUCK, "checklist-failed"])
        for column, language in enumerate(LANGUAGES)
    ],
)
def test_a_narrow_terminal_without_colour_in_the_c_locale(at: Quay, name: str, language: str) -> None:
    """Nothing is lost there, no colour is set, and no letter is sent that such a terminal cannot show."""
    columns, plain = 40, {"LANG": "C", "LC_ALL": "C", "NO_COLOR": "1"}
    words = ("--lang", language)
    if name == "checklist-failed":
        seen = checked(at.inventory.parent, language, columns, **plain)
    elif name in STRUCK:
        seen = struck(at, name, *words, columns=columns, **plain)
    else:
        seen = run(at, SITUATIONS[name], *words, columns=columns, **plain)
    assert not re.findall(rb"\x1b\[[0-9;]*m", seen.raw.replace(b"\x1b[0m", b""))
    assert seen.raw.isascii(), sorted({letter for letter in seen.raw.decode() if not letter.isascii()})
    text = "\n".join(seen.lines)
    assert any(line.startswith(VERDICTS) for line in seen.lines), text
    torn = [line for line in seen.lines if len(line) == columns and " " not in line.strip()]
    assert not [line for line in torn if not re.search(r"[/=:`.]|[0-9a-f]{16}", line)], torn
