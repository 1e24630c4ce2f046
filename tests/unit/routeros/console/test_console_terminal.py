"""The dialogue with a console: what succeeded, what was refused, what was printed."""

import pytest
from desk import ERROR, Desk, DeskWire

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros.console.terminal import Terminal
from atlantis_netcfg.routeros.console.types import ConsoleCommandError, ConsoleLoginError, ConsoleLost, SafeModeHeld

PIECES = pytest.mark.parametrize("piece", [1, 7, 65536])


def opened(desk: Desk, piece: int = 65536) -> tuple[Terminal, DeskWire]:
    wire = DeskWire(desk, piece)
    terminal = Terminal(wire, user="admin", name="router")
    terminal.settle(5)
    return terminal, wire


@PIECES
def test_command_returns_its_output(piece: int) -> None:
    desk = Desk({"/export": "# by RouterOS\n/ip address\nadd address=10.0.0.1/24"})
    console, _ = opened(desk, piece)
    assert console.run("/export", timeout_s=5) == "# by RouterOS\n/ip address\nadd address=10.0.0.1/24"
    assert console.run("/export", timeout_s=5) == "# by RouterOS\n/ip address\nadd address=10.0.0.1/24"


@PIECES
def test_a_command_may_print_nothing(piece: int) -> None:
    console, _ = opened(Desk({"/user disable admin": ""}), piece)
    assert console.run("/user disable admin", timeout_s=5) == ""


@PIECES
def test_refusal_is_reported_with_the_device_message(piece: int) -> None:
    console, _ = opened(Desk({"/ip address add": f"{ERROR}failure: already have such address"}), piece)
    with pytest.raises(ConsoleCommandError) as refused:
        console.run("/ip address add", timeout_s=5)
    assert refused.value.words == "failure: already have such address"
    assert str(refused.value) == "router: the device refused a command: failure: already have such address"


def test_an_echo_is_not_taken_for_success() -> None:
    desk = Desk({"/bad": f"{ERROR}failure: :put"})
    console, _ = opened(desk)
    with pytest.raises(ConsoleCommandError, match="failure: :put"):
        console.run("/bad", timeout_s=5)
    assert any('; :put "atlantis-done-' in line for line in desk.typed)


def test_a_secret_in_a_refusal_is_masked() -> None:
    console, _ = opened(Desk({"/user add password=hunter2": f"{ERROR}value hunter2 is too short"}))
    with pytest.raises(ConsoleCommandError) as refused:
        console.run("/user add password=hunter2", timeout_s=5, secrets=[Secret("hunter2")])
    assert "hunter2" not in str(refused.value) + refused.value.words
    assert refused.value.words == "value ******** is too short"


def test_command_with_a_line_break_is_rejected() -> None:
    console, _ = opened(Desk())
    with pytest.raises(ValueError, match="one line"):
        console.run("/ip address add\n/user remove admin")


@PIECES
def test_first_login_prompts_are_answered(piece: int) -> None:
    questions = [
        "Do you want to see the software license? [Y/n]: ",
        'The following default configuration has been installed:\r\nRemove this default configuration type "r"',
        "Change your password\r\n\r\nnew password> ",
    ]
    desk = Desk({"/x": "there"}, questions)
    console, _ = opened(desk, piece)
    assert desk.typed[:3] == ["n", "\r", "\x03"]
    assert console.run("/x", timeout_s=5) == "there"


def test_rows_are_parsed() -> None:
    answer = ".id=*1;address=10.0.0.1/24;comment=a;b;interface=ether1;.id=*2;address=10.0.0.2/24"
    console, _ = opened(Desk({":put [/ip address print detail as-value where disabled=no]": answer}))
    assert console.rows("/ip address", where="disabled=no", timeout_s=5) == [
        {".id": "*1", "address": "10.0.0.1/24", "comment": "a;b", "interface": "ether1"},
        {".id": "*2", "address": "10.0.0.2/24"},
    ]


def test_safe_mode_is_taken_and_released() -> None:
    desk = Desk()
    console, wire = opened(desk)
    console.take_safe_mode()
    assert (desk.safe, console.safe) == (True, True)
    console.take_safe_mode()
    assert desk.safe, "what is ours already is not pressed away"
    console.release_safe_mode()
    assert (desk.safe, console.safe) == (False, False)
    console.close()
    assert desk.typed[-1] == "/quit"
    assert wire.closed


def test_session_with_safe_mode_hangs_up_without_quit() -> None:
    desk = Desk()
    console, wire = opened(desk)
    console.take_safe_mode()
    console.close()
    assert wire.hung_up
    assert "/quit" not in desk.typed


def test_safe_mode_of_others_is_left_alone() -> None:
    desk = Desk({"/x": "fine"}, held=True)
    console, _ = opened(desk)
    with pytest.raises(SafeModeHeld):
        console.take_safe_mode()
    assert "d" in desk.typed
    assert console.run("/x", timeout_s=5) == "fine"


def test_command_on_a_lost_line_is_marked_in_flight() -> None:
    mark = '/user disable admin; :put "atlantis-done-2"'
    console, wire = opened(Desk({"/user disable admin": ""}, lost_at=mark))
    with pytest.raises(ConsoleLost) as lost:
        console.run("/user disable admin", timeout_s=5)
    assert lost.value.in_flight
    assert wire.closed
    with pytest.raises(ConsoleLost) as again:
        console.run("/x", timeout_s=5)
    assert not again.value.in_flight


def test_silence_ends_the_session() -> None:
    desk = Desk({"/x": "fine"})
    console, wire = opened(desk)
    desk.mute = True
    with pytest.raises(ConsoleLost, match="no response within 0 s"):
        console.run("/x", timeout_s=0.05)
    assert wire.closed


def test_failed_login_is_reported() -> None:
    desk = Desk(questions=["Login failed, incorrect username or password\r\n"])
    with pytest.raises(ConsoleLoginError, match="router: the device did not accept"):
        opened(desk)
