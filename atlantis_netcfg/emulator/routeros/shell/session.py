"""One console session: keys in, text out; greeting, prompt, command, page, question.

The questions of a first login have the device's text, because netmiko and community.routeros wait for it.

Assumption: console-first-login
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.emulator.routeros.shell import keys

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.device import ConsoleReply, Device


LICENCE = "Do you want to see the software license? [Y/n]: "
LICENCE_TEXT = "(the text of the software license is not rehearsed)"
DEFAULTS = """The following default configuration has been installed on your router:
-------------------------------------------------------------------------------
You can type "v" to see the exact commands that are used to add and remove
this default configuration, or you can view them later with
'/system default-configuration print' command.
To remove this default configuration type "r" or hit any other key to continue.
If you are connected using the above IP and you remove it, you will be
disconnected."""
PASSWORD = "Change your password"  # noqa: S105 (a heading)
NEW_PASSWORD = "new password> "  # noqa: S105 (a prompt)
REPEAT_PASSWORD = "repeat new password> "  # noqa: S105 (a prompt)
PASSWORD_DONE = "Password changed"  # noqa: S105 (a message)
MISMATCH = "Passwords do not match"


def banner(device: Device) -> str:
    """Return the login banner."""
    name = f"  MikroTik RouterOS {device.spec.version} (c) 1999-2025       https://www.mikrotik.com/"
    return f"\n\n{name}\n\nPress F1 for help\n"


def note(device: Device) -> str:
    """Return `/system/note` if it is shown at login."""
    settings = device.settings("/system/note")
    text = settings.get("note", "")
    return text if text and settings.get("show-at-login") == "yes" else ""


def pager(device: Device) -> str:
    """Return the line below a page; version 6 has another text."""
    return "-- [Q quit|D dump|down]" if device.at_least("7.0") else "-- [Q quit|D dump|right|down]"


_CTRL_C = "\x03"


class Greeting:
    """Asks pending login questions, then calls `then`."""

    def __init__(self, session: ConsoleSession, then: Callable[[], Awaitable[None]]) -> None:
        self._session = session
        self._device = session.talk.device
        self._then = then
        self._left = list(self._device.greetings(session.talk.caller))
        self._expected = ""

    async def next(self) -> None:
        """Ask the next question, or show the prompt."""
        session = self._session
        question = self._left.pop(0) if self._left else ""
        if question == "licence":
            session.ask(LICENCE, self._licence)
        elif question == "default-configuration":
            session.lines(DEFAULTS)
            session.ask("", self._defaults)
        elif question == "password":
            session.lines(PASSWORD)
            session.say("\r\n")
            self._new_password()
        else:
            await self._then()

    async def _licence(self, key: str) -> None:
        self._session.say(f"{key}\r\n" if key >= " " else "\r\n")
        if key.lower() not in ("n", _CTRL_C):
            self._session.lines(LICENCE_TEXT)
        self._device.finish_greeting("licence")
        await self.next()

    async def _defaults(self, key: str) -> None:
        if key.lower() == "v":
            self._session.lines(self._device.default_configuration())
            self._session.ask("", self._defaults)
            return
        self._device.finish_greeting("default-configuration")
        if key.lower() == "r":
            await self._session.talk.remove_defaults()
        await self.next()

    def _new_password(self) -> None:
        self._session.ask_secret(NEW_PASSWORD, self._take_password)

    async def _take_password(self, text: str) -> None:
        if text == _CTRL_C:
            await self.next()
            return
        self._expected = text
        self._session.ask_secret(REPEAT_PASSWORD, self._take_repeated_password)

    async def _take_repeated_password(self, text: str) -> None:
        if text == _CTRL_C:
            await self.next()
        elif text != self._expected:
            self._session.lines(MISMATCH)
            self._new_password()
        elif refusal := await self._session.talk.set_password(text):
            self._session.lines(refusal)
            self._new_password()
        else:
            self._device.finish_greeting("password")
            self._session.lines(f"\n{PASSWORD_DONE}")
            await self.next()


_PROBE = "\x1bZ\x1b[9999B\x1b[9999C\x1b[6n\r"
"""Terminal query for identification and for the last cursor position.

tik4net, Docs/findings-cli.md; community.routeros answers the first.
"""


class ConsoleSession:
    """A session from login to logout. `write` receives terminal bytes; `over`: the console has closed the session.

    The terminal is queried if its size is unknown; `give_up()` ends the wait for its response. The console then assumes
    that a terminal without size has no room: commands run, but their output is not drawn (seen over Telnet, tik4net,
    Docs/findings-cli.md).
    """

    def __init__(
        self, talk: ConsoleDevice, screen: keys.Screen, write: Callable[[bytes], None], *, has_size: bool = True
    ) -> None:
        self.talk = talk
        self.over = False
        self.quitted = False
        """The session ended by `/quit`: changes made in safe mode are kept."""
        self._write = write
        self._sized = has_size or not screen.detect
        self._keyboard = keys.Keyboard()
        self._line = keys.EditedLine(screen)
        self._history: list[str] = []
        self._recall = 0
        self._mode: Callable[[str | keys.Key], Awaitable[None]] = self._waiting
        self._answer: Callable[[str], Awaitable[None]]
        self._pages = keys.Pages("", screen)
        self.begun = False
        """Whether the terminal was identified, or identification was given up."""

    @property
    def screen(self) -> keys.Screen:
        """Properties that the console assumes of the terminal."""
        return self._line.screen

    # --- what happens to it ----------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Start the session after the login."""
        if self.screen.detect and not self.screen.dumb:
            self.say(_PROBE)
        else:
            await self._begin()

    async def give_up(self) -> None:
        """Stop waiting for the terminal's response to the size query."""
        if not self.begun:
            await self._begin()

    async def feed(self, data: bytes) -> None:
        """Process input from the terminal."""
        for key in self._keyboard.feed(data):
            if self.over:
                return
            if isinstance(key, keys.Position):
                self._set_size(key)
            if key is keys.Key.TERMINAL_ID or isinstance(key, keys.Position):
                await self.give_up()
            else:
                await self._mode(key)

    def resize(self, width: int, height: int) -> None:
        """Handle a new size of the terminal."""
        self._line.screen = self.screen.resize(width, height)

    def tell(self) -> None:
        """Show pending messages of the router."""
        for notice in self.talk.device.notices(self.talk.caller):
            self.say(f"\r\n{notice}\r\n")
            if self._mode == self._at_prompt:
                self._line.prompt = self.talk.device.prompt(self.talk.caller)
                self.say(self._line.afresh())

    def say(self, text: str) -> None:
        """Send text to the terminal."""
        if text:
            self._write(text.encode(errors="surrogateescape"))

    def lines(self, text: str) -> None:
        """Show complete lines."""
        if text and self._sized:
            self.say("".join(f"{line}\r\n" for line in keys.fold(text, self.screen.width)))

    def ask(self, question: str, answer: Callable[[str], Awaitable[None]]) -> None:
        """Ask a question that is answered by one key."""
        self.say(question)
        self._answer = answer
        self._mode = self._handle_question_key

    def ask_secret(self, prompt: str, answer: Callable[[str], Awaitable[None]]) -> None:
        """Ask for a hidden line; Ctrl+C is passed on as its own character."""
        self.say(self._line.begin(prompt, secret=True))
        self._answer = answer
        self._mode = self._handle_secret_key

    # --- beginning -------------------------------------------------------------------------------------------------

    def _set_size(self, corner: keys.Position) -> None:
        self._sized = True
        self._line.screen = self.screen.resize(corner.column, corner.row)

    async def _waiting(self, key: str | keys.Key) -> None:
        """Discard input before the prompt is shown. Assumption: console-first-login."""

    async def _begin(self) -> None:
        self.begun = True
        self.lines(banner(self.talk.device))
        self.lines(note(self.talk.device))
        await Greeting(self, self._show_prompt).next()

    async def _show_prompt(self) -> None:
        """Show the prompt and wait for a command."""
        self._mode = self._at_prompt
        self._recall = len(self._history)
        self.say(self._line.begin(self.talk.device.prompt(self.talk.caller)))

    # --- at the prompt ---------------------------------------------------------------------------------------------

    async def _at_prompt(self, key: str | keys.Key) -> None:
        if isinstance(key, str):
            self.say(self._line.insert(key))
        elif key is keys.Key.ENTER:
            await self._enter()
        elif key is keys.Key.SAFE:
            self.say("\r\n")
            await self._show_reply(await self.talk.safe_key(""), "")
        elif key is keys.Key.CANCEL:
            self.say("\r\n")
            await self._show_prompt()
        elif key is keys.Key.EOF and not self._line.text:
            self.say("\r\x1b7\x1b8" if not self.screen.dumb else "\r\n")
            self.over = True
        elif key in (keys.Key.UP, keys.Key.DOWN):
            self._recall_history(-1 if key is keys.Key.UP else 1)
        else:
            self.say(self._edit(key))

    def _edit(self, key: keys.Key) -> str:
        line = self._line
        moves = {
            keys.Key.LEFT: line.at - 1,
            keys.Key.RIGHT: line.at + 1,
            keys.Key.HOME: 0,
            keys.Key.END: len(line.text),
        }
        if key in moves:
            return line.move(moves[key])
        if key is keys.Key.BACKSPACE:
            return line.erase()
        if key in (keys.Key.DELETE, keys.Key.EOF):
            return line.erase(ahead=True)
        if key is keys.Key.KILL_LINE:
            return line.replace("")
        if key is keys.Key.KILL_END:
            return line.cut()
        return line.repaint() if key is keys.Key.REDRAW and not line.screen.dumb else ""

    def _recall_history(self, step: int) -> None:
        self._recall = min(max(self._recall + step, 0), len(self._history))
        text = self._history[self._recall] if self._recall < len(self._history) else ""
        self.say(self._line.replace(text))

    async def _enter(self) -> None:
        """Run the line; a capable terminal shows it once more before the output."""
        line = self._line.text
        ahead = self._line.move(len(line))
        again = ahead if self.screen.dumb or not line.strip() else self._line.repaint()
        self.say(f"{again}\r\n")
        if not line.strip():
            await self._show_prompt()
            return
        self._history.append(line)
        await self._show_reply(await self.talk.type(line, self.screen.width), line)

    async def _show_reply(self, reply: ConsoleReply, line: str) -> None:
        """Show the reply, and continue as it requests."""
        if reply.over:
            self.lines(reply.text)
            self.over = True
            self.quitted = reply.has_quit
        elif reply.asks:
            self.ask(reply.asks, lambda key: self._decide(key, line))
        elif reply.is_paged and not self.screen.dumb and self._sized:
            self._pages = keys.Pages(reply.text, self.screen)
            await self._show_page(self._pages.next())
        else:
            self.lines(reply.text)
            await self._show_prompt()

    async def _decide(self, key: str, line: str) -> None:
        """Handle the answer to a command's question: y for a command, u or r for safe mode; other keys mean no."""
        self.say(f"{key}\r\n" if key >= " " else "\r\n")
        if not line:
            await self._show_reply(await self.talk.safe_key(key.lower() if key >= " " else "d"), "")
        elif key.lower() == "y":
            await self._show_reply(await self.talk.confirm(line), line)
        else:
            await self._show_prompt()

    # --- other than the prompt -------------------------------------------------------------------------------------

    async def _handle_question_key(self, key: str | keys.Key) -> None:
        if key is keys.Key.FEED:
            return
        self._mode = self._waiting
        await self._answer(key if isinstance(key, str) else "\x03" if key is keys.Key.CANCEL else "\r")

    async def _handle_secret_key(self, key: str | keys.Key) -> None:
        if isinstance(key, str):
            self.say(self._line.insert(key))
        elif key is keys.Key.BACKSPACE:
            self.say(self._line.erase())
        elif key in (keys.Key.ENTER, keys.Key.CANCEL):
            text = self._line.text if key is keys.Key.ENTER else "\x03"
            self.say("\r\n")
            await self._answer(text)
        elif key is keys.Key.EOF:
            self.over = True

    async def _handle_pager_key(self, key: str | keys.Key) -> None:
        if key is keys.Key.FEED:
            return
        self.say("\r\x1b[K")
        if key in ("q", "Q", keys.Key.CANCEL):
            await self._show_prompt()
        elif key in ("d", "D"):
            await self._show_page(self._pages.rest())
        else:
            await self._show_page(self._pages.next(1 if key in (keys.Key.DOWN, keys.Key.ENTER) else None))

    async def _show_page(self, text: str) -> None:
        self.say(text)
        if self._pages.is_done:
            await self._show_prompt()
        else:
            self.say(pager(self.talk.device))
            self._mode = self._handle_pager_key


class ConsoleDevice(Protocol):
    """Console access of one caller. A method may never return if its connection has gone silent."""

    caller: Caller
    device: Device

    async def type(self, line: str, width: int | None) -> ConsoleReply:
        """Run a line."""

    async def safe_key(self, choice: str) -> ConsoleReply:
        """Press Ctrl+X, or answer its question."""

    async def confirm(self, line: str) -> ConsoleReply:
        """Run a line whose question was answered with yes."""

    async def set_password(self, password: str) -> str:
        """Set the caller's password; return the error text, or an empty string."""

    async def remove_defaults(self) -> None:
        """Remove the default configuration."""


class DirectTalk:
    """Console access without link and faults."""

    def __init__(self, device: Device, caller: Caller) -> None:
        self.device = device
        self.caller = caller

    async def type(self, line: str, width: int | None) -> ConsoleReply:
        """Run a line."""
        return self.device.type(self.caller, line, width=width)

    async def safe_key(self, choice: str) -> ConsoleReply:
        """Press Ctrl+X, or answer its question."""
        return self.device.safe_key(self.caller, choice)

    async def confirm(self, line: str) -> ConsoleReply:
        """Run a line whose question was answered with yes."""
        return self.device.type(self.caller, line, is_confirmed=True)

    async def set_password(self, password: str) -> str:
        """Set the caller's password; return the error text, or an empty string."""
        return self.device.set_password(self.caller, password)

    async def remove_defaults(self) -> None:
        """Remove the default configuration."""
        self.device.remove_defaults(self.caller)
