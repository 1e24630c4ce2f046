"""`provision robot retrieve` as it is typed, with a stand-in for ssh that answers in the place of the gateway."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hints_said import advised, said
from retrieval_programs import CENTRE, GATEWAY, KEY, ROBOT, with_retrieval

from atlantis_netcfg.cli import links, main
from atlantis_netcfg.cli.base.syntax import Arguments
from atlantis_netcfg.core.errors import ExitCode

SSH = """\
#!/bin/sh
for word in "$@"; do last="$word"; done
verb="${last##* }"
echo "$last" >> "$STAND_IN/typed"
cat > "$STAND_IN/asked-$verb"
[ -e "$STAND_IN/$verb" ] || { cat "$STAND_IN/error" >&2; exit 2; }
cat "$STAND_IN/$verb"
"""
LOOK = {
    "files": 3,
    "bytes": 200_000,
    "compared": 0,
    "kept": 1,
    "writing": 1,
    "unnamed": 0,
    "before": 1.0,
    "folder": True,
    "place": "/var/lib/svc-recording",
    "running": False,
}
STATUS = {
    "state": "done",
    "id": "r1",
    "link": "4g",
    "files": 3,
    "bytes": 200_000,
    "arrived": 3,
    "wire_bytes": 260_000,
    "running": False,
    "job": False,
    "since": 1000.0,
    "at": 1100.0,
    "left": {"changed": [], "gone": [], "differ": []},
}
GOES_ON = {**STATUS, "state": "sending", "arrived": 1, "running": True, "job": True}


class Desk:
    """Somebody who types, and a gateway that answers as it is told."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.capsys, self.monkeypatch = folder, capsys, monkeypatch

    def answers(self, **values: Any) -> None:  # noqa: ANN401 - JSON
        """By verb; None: it fails, and `error` is what it prints."""
        for verb, value in values.items():
            path = self.folder / verb
            if value is None:
                path.unlink(missing_ok=True)
            else:
                path.write_text(value if verb == "error" else json.dumps({"source": GATEWAY, **value}))

    def type(self, *words: str, code: int = 0) -> str:
        source = [] if any(word.startswith("from=") for word in words) else [f"from={GATEWAY}"]
        ended = main(["robot", "retrieve", "site=coastal", *source, *words])
        printed = self.capsys.readouterr()
        assert ended == code, f"exit {ended}\n{printed.out}{printed.err}"
        return printed.out + printed.err

    def verbs(self) -> list[str]:
        """What the gateway was asked."""
        path = self.folder / "typed"
        return [line.rpartition(" ")[2] for line in path.read_text().splitlines()] if path.exists() else []

    def job(self) -> dict[str, Any]:
        """What the gateway was told to do."""
        job: dict[str, Any] = json.loads((self.folder / "asked-start").read_text())
        return job


@pytest.fixture
def desk(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Desk:
    declared = with_retrieval(sources=[{"host": GATEWAY}], robots=[ROBOT])
    real = replace(declared, pilot=declared.pilot.model_copy(update={"example_values": False}))
    monkeypatch.setattr("atlantis_netcfg.inventory.load", lambda *_, **__: real)
    programs, answers = tmp_path / "bin", tmp_path / "answers"
    for folder in (programs, answers):
        folder.mkdir()
    (programs / "ssh").write_text(SSH)
    (programs / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:/usr/bin:/bin")
    monkeypatch.setenv("STAND_IN", str(answers))
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("ANSIBLE_SSH_CONTROL_PATH_DIR", str(tmp_path / "cp"))
    made = Desk(answers, capsys, monkeypatch)
    made.answers(look=LOOK, start={"started": True}, status=STATUS, stop={**GOES_ON, "state": "stopped"}, error="")
    return made


def in_use(desk: Desk, *names: str) -> None:
    """What the router says of its links."""
    status = SimpleNamespace(links=[SimpleNamespace(name=name, active=True) for name in names])
    desk.monkeypatch.setattr(links, "read_links", lambda _opened: status)


def test_plan_shows_the_cost_and_sends_nothing(desk: Desk) -> None:
    printed = desk.type("link=satellite", "--plan", code=2)
    for words in (
        "3 files to send, 200 kB",
        "1 file skipped: written less than a minute ago",
        "over metered link satellite of coastal: about 284 kB",
        "EUR",
        "priority low uses 20 % of the rate of satellite in the inventory",
    ):
        assert words in printed
    assert desk.verbs() == ["look"]


def test_metered_link_needs_consent_and_respects_the_cap(desk: Desk) -> None:
    assert "the cost was not accepted" in desk.type("link=satellite", code=4)
    desk.answers(look={**LOOK, "bytes": 10**10})
    assert "the limit for one action is" in desk.type("link=satellite", "--accept-cost", code=4)
    assert "start" not in desk.verbs()


def test_transfer_uses_the_link_in_use_and_ends_when_verified(desk: Desk) -> None:
    in_use(desk, "4g")
    assert "3 files: the same SHA-256 at both ends" in desk.type("files=bag-*", "--accept-cost")
    job = desk.job()
    assert (job["link"], job["pattern"], job["agreed_bytes"], job["silence_s"]) == ("4g", "bag-*", 200_000, 120)
    assert job["cap_bytes"] is not None
    assert job["rtt_max_s"] is not None, "a satellite is slower and dearer"
    assert desk.verbs() == ["look", "start", "status"]


def test_incomplete_transfer_is_not_green(desk: Desk) -> None:
    in_use(desk, "wifi-ptp")
    desk.answers(status={**STATUS, "arrived": 2, "left": {"changed": ["bag/a"], "gone": [], "differ": []}})
    assert "bag/a: changed while being sent" in desk.type(code=6)
    desk.answers(status={**STATUS, "state": "failed", "why": "no room: 12 bytes are missing"})
    assert "no room: 12 bytes are missing" in desk.type(code=4)
    assert json.loads(desk.type("--json", code=4))["whole"] is False


def test_ctrl_c_does_not_stop_the_transfer(desk: Desk) -> None:
    def stop(_seconds: float) -> None:
        raise KeyboardInterrupt

    desk.monkeypatch.setattr("atlantis_netcfg.cli.retrieve._pause", stop)
    desk.answers(status=GOES_ON)
    printed = desk.type("link=wifi-ptp", code=5)
    assert f"progress display ended; {GATEWAY} continues to send" in printed
    assert "stop" not in desk.verbs()


def test_temporarily_unreachable_gateway_is_awaited(desk: Desk) -> None:
    desk.answers(status=None, error="ssh: connect to host 10.64.1.10 port 22: Connection timed out")
    desk.monkeypatch.setattr("atlantis_netcfg.cli.retrieve._pause", lambda _seconds: desk.answers(status=STATUS))
    assert "the same SHA-256" in desk.type("link=wifi-ptp")
    assert desk.verbs()[-2:] == ["status", "status"]


def test_status_and_stop(desk: Desk) -> None:
    assert "3 files: the same SHA-256 at both ends" in desk.type("status")
    assert "no transfer is running" in desk.type("stop", code=7)
    desk.answers(status=GOES_ON, stop={**GOES_ON, "state": "stopped", "running": False, "job": False})
    assert "in progress: 1 of 3 files complete, 260 kB sent over 4g" in desk.type("status", code=6)
    assert "stopped; received files stay at the control centre" in desk.type("stop")
    assert "it does not accept `files=`" in desk.type("files=a", "stop", code=3)


def test_nothing_to_send_is_success_only_if_all_was_retrieved(desk: Desk) -> None:
    nothing = {**LOOK, "files": 0, "bytes": 0}
    desk.answers(look={**nothing, "writing": 0})
    assert "nothing to send" in desk.type("link=4g")
    desk.answers(look=nothing)
    assert "no file to send" in desk.type("link=4g", code=7)
    desk.answers(look={**nothing, "kept": 0, "writing": 0})
    assert "no file to send" in desk.type("link=4g", code=7)
    desk.answers(look={**nothing, "folder": False})
    assert f"{GATEWAY} has no such folder: /var/lib/svc-recording" in desk.type("link=4g", code=4)


def robot(desk: Desk, **seen: Any) -> None:  # noqa: ANN401 - JSON
    """What the gateway has seen of the robot."""
    there = {"state": "answers", "kind": "", "why": "", "files": 2, "bytes": 5_000_000, "lacking": 0}
    look = {**LOOK, "source": "sparus", "robot": {**there, **seen}}
    if seen.get("state") == "away":
        look = {**look, "files": 0, "bytes": 0}
    desk.answers(look=look, status={**STATUS, "source": "sparus"}, start={"started": True, "source": "sparus"})


def test_robot_recordings_are_collected_first(desk: Desk) -> None:
    robot(desk)
    assert f"2 files on sparus, 5.0 MB: {GATEWAY} collects these first" in desk.type("from=sparus", "link=wifi-ptp")
    assert desk.job()["source"] == "sparus"
    assert desk.job()["robot"] == "answers"
    assert json.loads(desk.type("from=sparus", "status", "--json"))["from"] == "sparus"
    desk.answers(look=LOOK)
    assert f"{GATEWAY} is not set up for this" in desk.type("from=sparus", "link=wifi-ptp", code=4), (
        "an older program would send the gateway's own"
    )


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        (
            {"state": "refused", "kind": "key", "why": "sparus does not admit the SSH host key of this gateway"},
            f'authorized_keys of recorder: restrict,command="rrsync -ro /home/recorder/bags" {KEY} {GATEWAY}',
        ),
        (
            {"state": "refused", "kind": "host_key", "why": "sparus has not its declared SSH host key"},
            "if it is the robot: set its new key as `host_key` of sparus in `retrieval.robots`",
        ),
        (
            {"state": "refused", "kind": "unread", "why": "sparus does not let its account read all of the folder"},
            "allow recorder to read all of /home/recorder/bags on sparus",
        ),
        ({"state": "away", "why": "sparus does not answer"}, "switch it on, connect it to the gateway's LAN"),
        ({"lacking": 2_000_000}, "raise its `budget_mb` in `retrieval.robots`"),
    ],
)
def test_unavailable_robot_is_refused_with_advice(desk: Desk, seen: dict[str, Any], words: str) -> None:
    robot(desk, **seen)
    printed = " ".join(desk.type("from=sparus", "link=wifi-ptp", code=4).split())
    assert words in printed
    assert seen.get("why", "2.0 MB more free space is needed on coastal-gateway for sparus") in printed
    assert desk.verbs() == ["look"], "nothing was begun"


def test_missing_source_lists_the_choices(desk: Desk) -> None:
    assert main(["robot", "retrieve", "site=coastal"]) == ExitCode.USAGE
    assert f"choose one of these: `from={GATEWAY}`, `from=sparus`" in desk.capsys.readouterr().err


def test_rehearsal_refuses_missing_tools_and_options(desk: Desk) -> None:
    desk.monkeypatch.setenv("PATH", "/nowhere")
    assert "rsync is not installed on this computer" in desk.type("--rehearse", code=3)
    assert "it does not accept `files=` or `--plan`" in desk.type("--rehearse", "files=a", "--plan", code=3)
    assert "has no link `5g`" in desk.type("--rehearse", "link=5g", code=3)
    assert desk.verbs() == []


SHOWN = "`provision robot retrieve site={} from={} status` shows it, `stop` instead ends it"


def not_begun(desk: Desk) -> str:
    desk.answers(start={"error": "running"})
    return desk.type("link=wifi-ptp", code=4)


def not_known(desk: Desk) -> str:
    in_use(desk)
    return desk.type(code=4)


def stopped(desk: Desk) -> str:
    desk.answers(status={**STATUS, "state": "stopped"})
    return desk.type("status", code=4)


def not_set_up(desk: Desk) -> str:
    desk.answers(look=None, error="python3: can't open file '/usr/local/lib/atlantis/retrieval.py'")
    printed = desk.type("link=wifi-ptp", code=4)
    assert f"device={CENTRE}" in printed
    return printed


ADVICE = {
    SHOWN: not_begun,
    "`provision links site={}` shows details; or choose one: `link=NAME`": not_known,
    "`provision robot retrieve site={} from={}` continues, and sends nothing twice": stopped,
    "run `provision site={} device={}` and `provision site={} device={}`": not_set_up,
}


@pytest.mark.parametrize("hint", ADVICE)
def test_advised_commands_work_when_typed(desk: Desk, hint: str) -> None:
    """Of commands about routers and roles it is held that they take these words; their devices are nowhere."""
    commands = advised(said(ADVICE[hint](desk), hint))
    desk.answers(look=LOOK, start={"started": True}, status=STATUS)
    in_use(desk, "wifi-ptp")
    reached: list[str] = []

    def reach(arguments: Arguments) -> ExitCode:
        reached.append(arguments.command.name)
        return ExitCode.DONE

    desk.monkeypatch.setattr("atlantis_netcfg.cli.links.run_links", reach)
    for name in ("run_site", "run_plan"):
        desk.monkeypatch.setattr(f"atlantis_netcfg.cli.runs.{name}", reach)
    assert [main(words) for words in commands] == [0] * len(commands)
    assert commands
    assert len(reached) == sum(words[1] != "retrieve" for words in commands)
