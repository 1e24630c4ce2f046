import json
import os
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import librouteros
import pytest
from pydantic import ValidationError
from waiting import HANG_S
from wire_helpers import PASSWORD, router_spec

from atlantis_netcfg.emulator.routeros import ControlError, EmulatorError, EmulatorSpec, SiteSpec, spawn

SITE = SiteSpec(name="coastal", emulators=(EmulatorSpec(router=router_spec()),))
RENAME = ["/system/identity/set", "=name=renamed"]


def process(tmp_path: Path, spec: SiteSpec = SITE) -> subprocess.Popen[str]:
    file = tmp_path / "site.json"
    file.write_text(spec.model_dump_json())
    return subprocess.Popen(
        [sys.executable, "-m", "atlantis_netcfg.emulator.routeros", str(file), "--state", str(tmp_path / "state")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def ask(twins: subprocess.Popen[str], line: str) -> Any:  # noqa: ANN401 - JSON
    assert twins.stdin is not None
    assert twins.stdout is not None
    if line:
        twins.stdin.write(line + "\n")
        twins.stdin.flush()
    return json.loads(twins.stdout.readline())


def test_the_protocol_and_sigterm(tmp_path: Path) -> None:
    with process(tmp_path) as twins:
        ready = ask(twins, "")
        assert ready["ready"] is True
        assert {"host", "api", "api_ssl", "ports", "pin", "address", "first_contact"} <= set(ready["twins"]["router"])
        assert ask(twins, "not json")["ok"] is False
        assert ask(twins, '{"do": "drop"}')["ok"] is False
        assert ask(twins, '{"twin": "router", "do": "export"}')["result"].startswith("# ")
        assert ask(twins, json.dumps({"twin": "router", "do": "console", "words": RENAME}))["ok"] is True
        twins.send_signal(signal.SIGTERM)
        assert twins.wait(HANG_S) == 0
    with process(tmp_path) as twins:
        assert ask(twins, "")["twins"]["router"]["pin"] == ready["twins"]["router"]["pin"]
        assert "name=renamed" in ask(twins, '{"twin": "router", "do": "export"}')["result"]
        twins.communicate("")
        assert twins.returncode == 0


def test_killed_process_has_saved_confirmed_changes(tmp_path: Path) -> None:
    with process(tmp_path) as twins:
        ask(twins, "")
        assert ask(twins, json.dumps({"twin": "router", "do": "console", "words": RENAME}))["ok"] is True
        twins.kill()
    assert "renamed" in (tmp_path / "state" / "router" / "flash.json").read_text()


def test_invalid_specification_exits_with_code_3(tmp_path: Path) -> None:
    (tmp_path / "site.json").write_text('{"name": "x", "emulators": [{"rooter": {}}]}')
    ended = subprocess.run(
        [sys.executable, "-m", "atlantis_netcfg.emulator.routeros", "site.json", "--state", "state"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 3
    assert "rooter" in ended.stderr
    assert ended.stdout == ""


def test_start_failure_of_emulators_is_explained(tmp_path: Path) -> None:
    spec = SiteSpec(name="coastal", emulators=(EmulatorSpec(router=router_spec(seed="/ip nonsense\nadd x=y")),))
    with pytest.raises(EmulatorError, match="twins of coastal do not start: SeedError: "):
        spawn(spec, tmp_path)


def test_duplicate_emulator_names_are_refused() -> None:
    with pytest.raises(ValidationError, match="two twins are called router"):
        SiteSpec(name="x", emulators=SITE.emulators * 2)


def test_spawned_emulators_serve_and_accept_commands(tmp_path: Path) -> None:
    with spawn(SITE, tmp_path) as twins:
        where = twins.ready["router"]
        librouteros.connect(where["host"], "provision", PASSWORD, port=where["api"]).close()
        assert twins.do("router", "counters")["logins"] == 1
        with pytest.raises(ControlError, match="explode"):
            twins.do("router", "explode")
    assert PASSWORD not in (tmp_path / "twins.log").read_text()
    assert (tmp_path / "site.json").stat().st_mode & 0o777 == 0o600


def test_dead_emulators_are_reported_with_their_log(tmp_path: Path) -> None:
    twins = spawn(SITE, tmp_path)
    twins._process.kill()
    twins._process.wait()
    with pytest.raises(EmulatorError, match="the process of the emulated devices has ended") as ended:
        twins.do("router", "info")
    assert ended.value.hint == "run the same command again"
    (tmp_path / "twins.log").write_text("one\nMemoryError\n")
    with pytest.raises(EmulatorError) as once_more:
        twins.do("router", "info")
    assert once_more.value.hint == "the end of its log:\none\nMemoryError"
    twins.close()


OWNER = """\
import json, os, signal, sys
from pathlib import Path
from atlantis_netcfg.emulator.routeros import SiteSpec, spawn
with spawn(SiteSpec.model_validate_json(sys.argv[1]), Path(sys.argv[2])) as site:
    worker = os.fork()
    if worker:
        print(json.dumps([site._process.pid, worker]), flush=True)
    signal.pause()
"""


def test_emulators_end_when_the_owner_is_killed_despite_a_live_fork(tmp_path: Path) -> None:
    words = [sys.executable, "-c", OWNER, SITE.model_dump_json(), str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        twins, worker = json.loads(owner.stdout.readline())
        end = os.pidfd_open(twins)
        owner.kill()
        try:
            assert select.select([end], [], [], 20)[0]
        finally:
            os.kill(worker, signal.SIGKILL)
            os.close(end)
