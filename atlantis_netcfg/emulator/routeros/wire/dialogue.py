"""One API session as sentences: login first, then sentences with tags; without bytes and time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import DONE_REPLY, Answer, Caller, Category, Trap

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.wire.link import WireBehaviour

Reply = tuple[str | None, Answer]
"""A reply sentence and the tag it carries."""


_INTERRUPTION = Trap("interrupted", Category.INTERRUPTION).answer()


def tag_of(words: Sequence[str]) -> str | None:
    """Return the sentence's `.tag`, or None."""
    return next((word.removeprefix(".tag=") for word in words if word.startswith(".tag=")), None)


class Dialogue:
    """State of a session: its login, and continuing sentences."""

    def __init__(self, device: Device, *, via: str, address: str) -> None:
        self.caller: Caller | None = None
        self._device = device
        self._via = via
        self._address = address
        self._challenge: str | None = None
        self._sentences = 0
        self._completed = 0
        self._greeted_at = 0
        self._going_on: list[str | None] = []

    def answer(self, words: Sequence[str], answer_count: int, knobs: WireBehaviour) -> list[Reply]:
        """Return the replies to a sentence sent after its client had seen `answer_count` completed replies."""
        self._sentences += 1
        tag = tag_of(words)
        command = words[0]
        if self.caller is None:
            answers = [(tag, answer) for answer in self._before_login(command, words, knobs)]
        elif answer_count < self._greeted_at and not knobs.pipelined_login:
            answers = [(None, Answer.fatal("not logged in"))]
        elif command == "/cancel":
            answers = self._cancel(self.caller, tag, words)
        else:
            answers = self._run(self.caller, tag, words)
        return self._count_completed(answers)

    def pending(self) -> list[Reply]:
        """Return later replies of continuing sentences."""
        if self.caller is None:
            return []
        return self._count_completed(self._pending(self.caller))

    @property
    def is_evicted(self) -> bool:
        """Whether this session was removed from `/user/active`."""
        return self.caller is not None and self.caller.number in self._device.closed_sessions

    def leave(self) -> None:
        """End the session in the regular way."""
        if self.caller is not None:
            self._device.logout(self.caller, clean=True)
            self.caller = None

    def forget(self) -> None:
        """Forget the session after a reboot."""
        self.caller = None

    def _before_login(self, command: str, words: Sequence[str], knobs: WireBehaviour) -> list[Answer]:
        if command == "/quit":
            return [Answer.fatal("session terminated on request")]
        if self._sentences > knobs.sentences_before_login:
            return [Answer.fatal("too many commands before login")]
        if command != "/login":
            return [Answer.fatal("not logged in")]
        try:
            answer = self._login(words, knobs)
        except Trap as refused:
            return [refused.answer(), DONE_REPLY]
        if self.caller is not None:
            self._greeted_at = self._completed + 1
        return [answer]

    def _login(self, words: Sequence[str], knobs: WireBehaviour) -> Answer:
        """Log in: since 6.43 with name and password, before with challenge and response (Manual, API)."""
        arguments = dict(word[1:].partition("=")[::2] for word in words[1:] if word.startswith("="))
        user = arguments.get("name", "")
        if "response" in arguments:
            challenge, self._challenge = self._challenge, None
            if challenge is None:
                raise Trap("cannot log in")
            self.caller = self._device.login_response(
                user, challenge, arguments["response"], via=self._via, address=self._address
            )
        elif knobs.old_login or "name" not in arguments:
            self._challenge = self._device.challenge()
            return Answer.done_reply(self._challenge)
        else:
            self.caller = self._device.login(user, arguments.get("password", ""), via=self._via, address=self._address)
        return DONE_REPLY

    def _run(self, caller: Caller, tag: str | None, words: Sequence[str]) -> list[Reply]:
        answers = self._device.run(caller, words)
        if not (answers and answers[-1].last):
            self._going_on.append(tag)
        return [(tag, answer) for answer in answers]

    def _pending(self, caller: Caller) -> list[Reply]:
        later = [(tag or None, answer) for tag, answer in self._device.pending(caller)]
        return [reply for reply in later if reply[0] in self._going_on]

    def _cancel(self, caller: Caller, tag: str | None, words: Sequence[str]) -> list[Reply]:
        """Cancel continuing sentences; the `!done` of `/cancel` precedes theirs (Manual, API, its own example)."""
        earlier = self._pending(caller)
        tags = [word.removeprefix("=tag=") for word in words if word.startswith("=tag=")]
        victims = [other for other in self._going_on if not tags or other in tags]
        self._going_on = [other for other in self._going_on if other not in victims]
        self._device.run(caller, words)
        others = self._pending(caller)
        interruptions: Iterable[Reply] = ((victim, _INTERRUPTION) for victim in victims)
        return [*earlier, *interruptions, (tag, DONE_REPLY), *((victim, DONE_REPLY) for victim in victims), *others]

    def _count_completed(self, replies: list[Reply]) -> list[Reply]:
        self._completed += sum(answer.last for _, answer in replies)
        return replies
