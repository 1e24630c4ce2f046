"""Questions that end in yes or no: which answers they take, in both languages, and what agrees to nothing."""

from collections.abc import Callable, Iterator

import pytest

from atlantis_netcfg.cli.base.consent import (
    ConsentRefusal,
    confirm_cost,
    confirm_removal,
    require_agreement,
    shown_word,
    whole_word,
    yes_or_no,
)
from atlantis_netcfg.core import language
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.language import Language
from atlantis_netcfg.links.cost import CostRefusal


class Typist:
    """Answers question by question; None is the end of the input."""

    def __init__(self, *typed: str | None) -> None:
        self.typed = list(typed)
        self.asked: list[str] = []
        self.said: list[str] = []

    def read(self, question: str) -> str | None:
        self.asked.append(question)
        return self.typed.pop(0)

    def say(self, text: str) -> None:
        self.said.append(text)


@pytest.fixture(params=Language)
def spoken(request: pytest.FixtureRequest) -> Iterator[Language]:
    language.use(request.param)
    yield request.param
    language.use(Language.ENGLISH)


@pytest.mark.parametrize("word", ["yes", "YES", " Yes ", "y", "Y"])
def test_yes_is_accepted_in_every_language(word: str, spoken: Language) -> None:
    assert shown_word("yes") == {Language.ENGLISH: "yes", Language.PORTUGUESE: "sim"}[spoken]
    assert yes_or_no("Is it?", Typist(word).read)


@pytest.mark.parametrize("word", ["no", "NO", " n", "N"])
def test_no_is_accepted_in_every_language(word: str, spoken: Language) -> None:
    assert spoken in Language
    assert not yes_or_no("Is it?", Typist(word).read)
    assert not whole_word("Do it?", Typist(word).read)


@pytest.mark.usefixtures("portuguese")
@pytest.mark.parametrize(
    ("word", "agrees"),
    [
        ("sim", "agrees"),
        ("S", "agrees"),
        ("não", "declines"),
        ("na\u0303o", "declines"),
        ("NAO", "declines"),
        ("n", "declines"),
    ],
)
def test_portuguese_answers_are_accepted_in_portuguese(word: str, agrees: str) -> None:
    typist = Typist(word)
    assert yes_or_no("Is it?", typist.read, typist.say) is (agrees == "agrees")
    assert (typist.asked, typist.said) == (["Is it? [sim, não] "], [])


@pytest.mark.parametrize("word", ["sim", "s", "não"])
def test_portuguese_answers_are_refused_in_english(word: str) -> None:
    typist = Typist(word, "no")
    assert not whole_word("Do it?", typist.read, typist.say)
    assert typist.said == ["  type the whole word yes, or no"]


@pytest.mark.parametrize("word", ["", "y", "ye", "yes!", "ok", "pay", "1", "true"])
@pytest.mark.parametrize("ask", [whole_word, yes_or_no])
def test_other_answers_are_asked_again(ask: Callable[..., bool], word: str) -> None:
    if ask is yes_or_no and word == "y":
        return
    typist = Typist(word, "yes")
    assert ask("Do it?", typist.read, typist.say)
    assert len(typist.asked) == 2
    assert len(typist.said) == 1


def test_three_invalid_answers_mean_no() -> None:
    typist = Typist("y", "ok", "sure", "yes")
    assert not whole_word("Do it?", typist.read, typist.say)
    assert typist.typed == ["yes"]


@pytest.mark.parametrize("ask", [whole_word, yes_or_no])
def test_end_of_input_means_no(ask: Callable[..., bool]) -> None:
    typist = Typist(None)
    assert not ask("Do it?", typist.read, typist.say)
    assert typist.said == []


def test_prompt_says_that_the_whole_word_is_needed() -> None:
    typist = Typist("no")
    assert not whole_word("Change coastal-router?", typist.read)
    assert typist.asked == ["Change coastal-router?\n  Type yes (the whole word) to continue, or no: "]


@pytest.mark.parametrize("word", ["pay", "remove"])
def test_each_prompt_accepts_only_its_own_word(word: str) -> None:
    for other in ("yes", "y", "sim", *{"pay", "remove"} - {word}):
        assert not whole_word("Go on?", Typist(other, "no").read, lambda _words: None, word=word)
    assert whole_word("Go on?", Typist(word).read, word=word)
    assert not whole_word("Go on?", Typist(word, "no").read, lambda _words: None)


class Somebody:
    """A terminal with a person."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    def types(word: str) -> None:
        monkeypatch.setattr("builtins.input", lambda _question: word)

    monkeypatch.setattr("sys.stdin", Somebody())
    return types


def test_device_changes_need_the_whole_word(terminal: Callable[[str], None]) -> None:
    terminal("yes")
    require_agreement("Change it now?")
    for word in ("y", "no", "pay", ""):
        terminal(word)
        with pytest.raises(ConsentRefusal, match="not confirmed; nothing was changed"):
            require_agreement("Change it now?")


def test_cost_and_removal_have_their_own_words(terminal: Callable[[str], None]) -> None:
    terminal("pay")
    confirm_cost(["over satellite: 1 EUR"], ask=True)
    with pytest.raises(ConsentRefusal):
        confirm_removal(["3 rows of others"], ask=True)
    terminal("remove")
    confirm_removal(["3 rows of others"], ask=True)
    for typed, ask in (("remove", True), ("pay", False)):
        terminal(typed)
        with pytest.raises(CostRefusal):
            confirm_cost(["over satellite: 1 EUR"], ask=ask)


def test_ctrl_c_at_a_prompt_changes_nothing(monkeypatch: pytest.MonkeyPatch, terminal: Callable[[str], None]) -> None:
    def stopped(_question: str) -> str:
        raise KeyboardInterrupt

    terminal("")
    monkeypatch.setattr("builtins.input", stopped)
    with pytest.raises(ConsentRefusal, match="interrupted by Ctrl-C at the prompt; nothing was changed"):
        require_agreement("Change it now?")


def test_consent_fails_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    with pytest.raises(UsageError, match="no terminal to confirm"):
        require_agreement("Change it now?")
