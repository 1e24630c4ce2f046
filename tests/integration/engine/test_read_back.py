"""After a change of menus that nothing follows: these are read in full, the others counted, and what moved is read."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from engine_bench import TEXT, Bench, Meddler, on

from atlantis_netcfg.routeros import DeviceResult, JobMode, Status
from atlantis_netcfg.routeros._types import Observed
from atlantis_netcfg.routeros.apply import Admission
from atlantis_netcfg.routeros.estimate import BearerProfile, Estimate

RULE = 'add action=passthrough chain=forward comment="atlantis: one more"\n'
MORE = TEXT.replace("/ip firewall nat\n", f"{RULE}/ip firewall nat\n")
SATELLITE = BearerProfile("satellite", 0.7, 352e3, 704e3, metered=True)


def meddled(tmp_path: Path, words: Sequence[str], path: str = "/execute") -> tuple[DeviceResult, str, list[str]]:
    """Add a rule of the firewall while somebody else does something; the result, the export, and what was read back."""

    async def act(bench: Bench) -> tuple[DeviceResult, str, list[str]]:
        bench.text = TEXT
        await bench.converge()
        bench.text = MORE
        meddler = Meddler(path, lambda: bench.router.console(list(words)), nth=3)
        result = await bench.converge(connect=meddler.connect)
        last = bench.router.connections()[-1]
        return result, bench.export(), [sentence[0] for sentence in last.sentences if "=count-only=" not in sentence]

    return on(Bench(tmp_path), act)


def test_only_what_was_touched_is_read_in_full(tmp_path: Path) -> None:
    result, _, full = meddled(tmp_path, ["/system/identity/print"])
    assert result.status is Status.CHANGED
    assert set(full) == {"/login", "/ip/firewall/filter/print", "/system/resource/print", "/safe-mode/print"}


def test_a_menu_that_somebody_has_added_to_is_read_as_well(tmp_path: Path) -> None:
    result, export, full = meddled(tmp_path, ["/ip/pool/add", "=name=theirs", "=ranges=10.0.0.1"])
    assert result.status is Status.CHANGED
    assert "name=theirs" in export
    assert "/ip/pool/print" in full


def test_a_row_that_somebody_has_removed_meanwhile_is_missed(tmp_path: Path) -> None:
    result, export, _ = meddled(tmp_path, ["/ip/firewall/address-list/remove", "=.id=*1"])
    assert result.status is not Status.CHANGED, result.message
    assert "one more" not in export


class Dear:
    """Refuses whatever would be sent."""

    def judge(self, seen: Observed, estimate: Estimate | None, *, spends: bool, planned: bool) -> Admission:  # noqa: ARG002
        return Admission((), "too dear" if spends else None)


@pytest.mark.parametrize("mode", [JobMode.APPLY, JobMode.RESUME])
def test_safe_mode_that_was_taken_for_a_refused_plan_is_released(tmp_path: Path, mode: JobMode) -> None:
    """Released, not taken back: what somebody else has done meanwhile is theirs."""

    async def act(bench: Bench) -> tuple[DeviceResult, str, DeviceResult]:
        pool = ["/ip/pool/add", "=name=theirs", "=ranges=10.0.0.1"]
        meddler = Meddler("/safe-mode/take", lambda: bench.router.console(pool))
        refused = await bench.converge(mode, connect=meddler.connect, cost_policy=Dear(), bearer=SATELLITE)
        assert meddler.count == 1
        return refused, bench.export(), await bench.converge()

    refused, export, then = on(Bench(tmp_path), act)
    assert (refused.status, refused.message) == (Status.REFUSED, "refused, nothing was changed: too dear")
    assert "name=theirs" in export
    assert then.status is Status.CHANGED


def test_a_plan_takes_no_safe_mode(tmp_path: Path) -> None:
    async def act(bench: Bench) -> list[str]:
        await bench.converge(JobMode.PLAN)
        return [sentence[0] for each in bench.router.connections() for sentence in each.sentences]

    assert "/safe-mode/take" not in on(Bench(tmp_path), act)
