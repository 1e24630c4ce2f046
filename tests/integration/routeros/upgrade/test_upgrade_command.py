"""`provision device upgrade` as a person types it, against the emulated router."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import preforked
import pytest
from npk_files import write


@pytest.fixture
def provision(tmp_path: Path) -> Any:  # noqa: ANN401
    def call(*words: str) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path / "state")}
        return preforked.run(["device", "upgrade", "site=coastal", "device=coastal-router", *words], env=environment)

    return call


def test_a_plan_shows_files_and_cost_and_changes_nothing(tmp_path: Path, provision: Any) -> None:  # noqa: ANN401
    path = write(tmp_path, "routeros", "7.21.5", "arm64", payload=2_000_000)
    radio = write(tmp_path, "wifi-qcom", "7.21.5", "arm64")
    told = provision(f"packages={path}", f"packages={radio}", "via=satellite", "--plan", "--rehearse")
    assert told.returncode == 2, told.stderr
    assert "RouterOS 7.18.2 -> 7.21.5" in told.stdout
    assert "2.0 MB over satellite, which is metered: about" in told.stdout
    assert "over metered link satellite of coastal: about 2.4 MB, " in told.stdout


def test_rehearsal_reports_the_version_read_back(tmp_path: Path, provision: Any) -> None:  # noqa: ANN401
    path, radio = (write(tmp_path, name, "7.21.5", "arm64") for name in ("routeros", "wifi-qcom"))
    done = provision(f"packages={path}", f"packages={radio}", "--rehearse", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["status"], result["before"], result["after"]) == ("changed", "7.18.2", "7.21.5")
    assert result["packages"] == ["routeros", "wifi-qcom"]


def test_device_already_on_target_version_is_left_alone(tmp_path: Path, provision: Any) -> None:  # noqa: ANN401
    path = write(tmp_path, "routeros", "7.18.2", "arm64")
    done = provision(f"packages={path}", "--rehearse")
    assert (done.returncode, done.stdout.split()[1:]) == (0, ["unchanged:", "RouterOS", "7.18.2"])


REFUSED = {
    "not a package": (3, "not a RouterOS package"),
    "another board": (4, "is for arm, the device is arm64"),
    "back": (4, "this command does not downgrade to 7.16"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusal_states_reason_and_file(tmp_path: Path, provision: Any, case: str) -> None:  # noqa: ANN401
    exit_, words = REFUSED[case]
    architecture = "arm" if case == "another board" else "arm64"
    path = write(tmp_path, "routeros", "7.16" if case == "back" else "7.21.5", architecture)
    if case == "not a package":
        path.write_bytes(b"<html>404</html>")
    done = provision(f"packages={path}", "--rehearse", "--yes")
    assert done.returncode == exit_, done.stdout + done.stderr
    assert words in done.stderr
    assert path.name in done.stderr or case == "back"
