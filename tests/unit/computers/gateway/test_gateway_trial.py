"""The connection test says no more than can be seen from the gateway."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.filesystem import FileSystem
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.connection_test import SmokeTest

ADDRESS = ProgramResult(0, "3: tun0    inet 10.80.0.10/16 scope global tun0")
TRIAL = SmokeTest("/b/example-robot", "/b/c.yml", "/interop.sh", "/ros.env", "/b/build.json", "someone", "tun0", 15)


@dataclass
class Gateway:
    root: Path
    address: ProgramResult = ADDRESS
    end: ProgramResult = field(default_factory=lambda: ProgramResult(124, "TEST_ROBOT\n"))
    commands: list[list[str]] = field(default_factory=list)

    def put(self, path: str, text: str) -> None:
        place = self.root / path[1:]
        place.parent.mkdir(exist_ok=True)
        place.write_text(text)

    def run(self, argv: list[str]) -> ProgramResult:
        self.commands.append(argv)
        return self.address if argv[0] == "ip" else self.end

    def judge(self, *, check: bool = False) -> str:
        told = TRIAL.judge(FileSystem(str(self.root)), check=check, run=self.run)
        return f"{told.verdict}{'' if told.worth else ' (silent)'}: {told.words}"


@pytest.fixture
def gateway(tmp_path: Path) -> Gateway:
    made = Gateway(tmp_path)
    for path in (TRIAL.program, TRIAL.config, TRIAL.environment, TRIAL.built):
        made.put(path, "one")
    return made


def test_running_program_is_inconclusive_and_not_restarted(gateway: Gateway) -> None:
    assert gateway.judge(check=True).startswith("SKIP (silent)")
    assert not gateway.commands
    assert gateway.judge().startswith(
        "INCONCLUSIVE: INCONCLUSIVE: example-robot ran for 15 s without an error; "
        "only a person at the SCC can see whether"
    )
    assert "--uid=someone" in gateway.commands[-1]
    assert "--property=EnvironmentFile=/ros.env" in gateway.commands[-1]
    assert gateway.judge().startswith("SKIP (silent)")
    for changed in (TRIAL.built, TRIAL.config, TRIAL.environment):
        gateway.put(changed, "two")
        assert gateway.judge().startswith("INCONCLUSIVE")
        gateway.put(changed, "one")
        gateway.judge()


def test_program_that_exits_cleanly_is_inconclusive(gateway: Gateway) -> None:
    gateway.end = ProgramResult(0, "")
    assert "ended by itself, without an error" in gateway.judge()


def test_error_fails_and_is_retried(gateway: Gateway) -> None:
    gateway.end = ProgramResult(2, "starting\nerror: C4i does not answer\n")
    with pytest.raises(
        ModuleError, match=r"FAIL: example-robot exited with 2 .*:\nerror: C4i does not answer"
    ) as caught:
        gateway.judge()
    assert "C4i" in caught.value.hint
    gateway.end = ProgramResult(124, "")
    assert gateway.judge().startswith("INCONCLUSIVE")


@pytest.mark.parametrize("address", [ProgramResult(1, 'Device "tun0" does not exist.'), ProgramResult(0, "")])
def test_program_is_not_started_without_the_vpn(gateway: Gateway, address: ProgramResult) -> None:
    gateway.address = address
    assert gateway.judge().startswith("SKIP: example-robot was not started: tun0, the VPN's interface, has no address")
    assert len(gateway.commands) == 1


def test_missing_program_is_named(gateway: Gateway) -> None:
    (gateway.root / "b/example-robot").unlink()
    with pytest.raises(ModuleError, match="the build does not contain /b/example-robot"):
        gateway.judge()
