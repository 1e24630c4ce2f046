import hashlib
from itertools import pairwise
from pathlib import Path

import pytest
from librouteros.protocol import encode_word
from wire_helpers import PASSWORD, Client, router, row, run

import atlantis_netcfg.emulator.routeros as package
from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterLink, RouterSpec, SiteSpec, WireBehaviour

pytestmark = pytest.mark.coroutine(run=run)
PRINT = "/system/identity/print"
DONE = ("!done", ())


async def test_commands_before_login_are_refused(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        client.write((PRINT,))
        assert await client.transport.reader.read() == b"\x06!fatal\x0dnot logged in\x00"


async def test_login_succeeds_after_a_wrong_password(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        assert await client.login(password="guess") == [
            ("!trap", ("=message=invalid user name or password (6)",)),
            DONE,
        ]
        assert await client.login() == [DONE]
        assert row((await client.talk(PRINT))[0])["name"]
        assert twin.counters().logins == 1
        assert PASSWORD not in str(twin.connections())


@pytest.mark.parametrize("knobs", [WireBehaviour(), WireBehaviour(old_login=True)])
async def test_login_before_6_43(tmp_path: Path, knobs: WireBehaviour) -> None:
    async with router(tmp_path, knobs=knobs) as twin, Client(twin) as client:
        first = ("/login", "=name=provision", f"=password={PASSWORD}") if knobs.old_login else ("/login",)
        ((_, (ret,)),) = await client.talk(*first)
        challenge = bytes.fromhex(ret.removeprefix("=ret="))
        digest = hashlib.md5(b"\0" + PASSWORD.encode() + challenge, usedforsecurity=False).hexdigest()
        assert await client.talk("/login", "=name=provision", f"=response=00{digest}") == [DONE]
        assert (await client.talk(PRINT))[-1] == DONE


async def test_a_response_without_challenge_is_refused(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        answer = await client.talk("/login", "=name=provision", "=response=00" + "ab" * 16)
        assert answer == [("!trap", ("=message=cannot log in",)), DONE]


async def test_repeated_login_failures_close_the_connection(tmp_path: Path) -> None:
    async with router(tmp_path, knobs=WireBehaviour(sentences_before_login=2)) as twin, Client(twin) as client:
        await client.login(password="a")
        await client.login(password="b")
        client.write(("/login", "=name=provision", f"=password={PASSWORD}"))
        assert b"too many commands before login" in await client.transport.reader.read()


async def test_long_words_are_accepted_only_after_login(tmp_path: Path) -> None:
    long = "=comment=" + "x" * 5000
    async with router(tmp_path) as twin:
        async with Client(twin) as client:
            client.write(("/login", long))
            assert await client.ends()
        async with Client(twin) as client:
            await client.login()
            assert (await client.talk("/ip/pool/add", "=name=p", "=ranges=10.0.0.2-10.0.0.9", long))[-1][0] == "!done"


@pytest.mark.parametrize("accepted", [False, True])
async def test_commands_pipelined_with_the_login(tmp_path: Path, *, accepted: bool) -> None:
    async with router(tmp_path, knobs=WireBehaviour(pipelined_login=accepted)) as twin, Client(twin) as client:
        client.write(("/login", "=name=provision", f"=password={PASSWORD}"), (PRINT,))
        assert await client.answer() == [DONE]
        if accepted:
            assert (await client.answer())[-1] == DONE
            assert twin.counters().turns == 1
        else:
            assert b"not logged in" in await client.transport.reader.read()


async def test_every_reply_carries_its_tag(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        client.write((PRINT, ".tag=a b"), ("/nonsense", ".tag=2"))
        answer = await client.answer()
        assert [kind for kind, _ in answer] == ["!re", "!done"]
        assert all(words[0] == ".tag=a b" for _, words in answer)
        refusal = await client.answer()
        assert [kind for kind, _ in refusal] == ["!trap", "!done"]
        assert all(words[0] == ".tag=2" for _, words in refusal)


async def test_quit_is_answered_without_tag_and_closed(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        client.write(("/quit", ".tag=1"))
        assert await client.transport.reader.read() == b"\x06!fatal\x1dsession terminated on request\x00"


async def test_split_words_and_empty_sentences_are_accepted(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        client.raw(b"\0\0")
        for byte in encode_word(PRINT, "utf-8"):
            client.raw(bytes([byte]))
        assert client.silent
        client.raw(b"\0")
        assert (await client.answer())[-1] == DONE


async def test_reserved_control_byte_closes_connection_after_earlier_reply(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        client.raw(encode_word(PRINT, "utf-8") + b"\0\xf8")
        assert (await client.answer())[-1] == DONE
        assert await client.ends()


@pytest.mark.parametrize(("version", "kinds"), [("7.16", ["!done"]), ("7.18.2", ["!empty", "!done"])])
async def test_a_print_without_rows(tmp_path: Path, version: str, kinds: list[str]) -> None:
    async with router(tmp_path, version=version) as twin, Client(twin) as client:
        await client.login()
        assert [kind for kind, _ in await client.talk("/ip/pool/print", "?name=none")] == kinds


async def test_listen_continues_until_cancelled(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client, Client(twin) as other:
        await client.login()
        await other.login()
        client.write(("/ip/pool/listen", ".tag=7"))
        ((_, (ret,)),) = await other.talk("/ip/pool/add", "=name=p", "=ranges=10.0.0.2-10.0.0.9")
        seen = await client.read()
        assert row(seen)["name"] == "p"
        assert seen[1][0] == ".tag=7"
        await other.talk("/ip/pool/remove", f"=.id={ret.removeprefix('=ret=')}")
        assert row(await client.read())[".dead"] == "true"
        client.write(("/cancel", "=tag=7", ".tag=8"))
        assert [await client.read() for _ in range(3)] == [
            ("!trap", (".tag=7", "=category=2", "=message=interrupted")),
            ("!done", (".tag=8",)),
            ("!done", (".tag=7",)),
        ]
        await other.talk("/ip/pool/add", "=name=q", "=ranges=10.0.1.2-10.0.1.9")
        assert (await client.talk(PRINT))[0][0] == "!re"


def _pools(count: int) -> list[tuple[str, ...]]:
    return [
        ("/ip/pool/add", f"=name=p{number}", f"=ranges=10.0.{number}.2-10.0.{number}.9", f".tag={number}")
        for number in range(count)
    ]


@pytest.mark.parametrize("seed", [None, 1])
def test_tagged_burst_is_executed_in_any_order(tmp_path: Path, seed: int | None) -> None:
    async def main() -> list[str]:
        async with router(tmp_path, knobs=WireBehaviour(shuffle=seed)) as twin, Client(twin) as client:
            await client.login()
            client.write(*_pools(12))
            for _ in range(12):
                assert (await client.read())[0] == "!done"
            return [row(reply)["name"] for reply in (await client.talk("/ip/pool/print"))[:-1]]

    names = run(main())
    assert sorted(names) == sorted(f"p{number}" for number in range(12))
    assert (names == [f"p{number}" for number in range(12)]) is (seed is None)


async def test_replies_to_a_shuffled_burst_interleave(tmp_path: Path) -> None:
    async with router(tmp_path, knobs=WireBehaviour(shuffle=2)) as twin, Client(twin) as client:
        await client.login()
        client.write(*(("/ip/service/print", f".tag={number}") for number in range(3)))
        tags, done = [], 0
        while done < 3:
            kind, words = await client.read()
            tags.append(words[0])
            done += kind == "!done"
        assert sum(one != other for one, other in pairwise(tags)) > 2
        assert len(set(tags)) == 3


@pytest.mark.parametrize(("sentences", "hangs"), [(16, False), (24, False), (25, True)])
async def test_too_many_requests_in_flight_hang_the_connection(tmp_path: Path, sentences: int, *, hangs: bool) -> None:
    async with router(tmp_path, knobs=WireBehaviour(hang_at=25)) as twin, Client(twin) as client, Client(twin) as other:
        await client.login()
        await other.login()
        client.write(*((PRINT, f".tag={number}") for number in range(sentences)))
        assert (await other.talk(PRINT))[-1] == DONE
        if hangs:
            assert client.silent
        else:
            for _ in range(sentences):
                assert (await client.answer())[-1][0] == "!done"


async def test_two_batches_of_sixteen_stay_below_the_limit(tmp_path: Path) -> None:
    async with router(tmp_path, knobs=WireBehaviour(hang_at=25)) as twin, Client(twin) as client:
        await client.login()
        for _ in range(2):
            client.write(*((PRINT, f".tag={number}") for number in range(16)))
            for _ in range(16):
                assert (await client.answer())[-1][0] == "!done"
        assert twin.counters().turns == 3


def test_public_names_of_the_package() -> None:
    assert set(package.__all__) == {
        *("COMMANDS", "NOT_REHEARSED", "Air", "DiscoveryNeighbour", "CellSpec", "WireCounters", "Deviation", "Device"),
        *("DeviceMode", "Environment", "Execute", "LinkFault", "FaultKind", "RouterLink", "Load"),
        *("ManagementSpec", "DeviceModeName", "ModemSpec", "Radio", "RadioLink", "RadioPair", "EmulatedRouter"),
        *("RouterSpec", "RunningSite", "Service", "SimSpec", "EmulatedSite", "SiteSpec", "SpawnedSite"),
        *("TrafficCounters", "ControlError", "EmulatorSpec", "EmulatorError", "User", "Validity"),
        *("WireBehaviour", "spawn"),
    }
    assert all(hasattr(package, name) for name in package.__all__)


def test_a_site_survives_json() -> None:
    twin = EmulatorSpec(
        router=RouterSpec(name="router"), link=RouterLink(delay_s=0.35, rate_up_bps=176_000), ports={8729: 18729}
    )
    site = SiteSpec(name="coastal", emulators=(twin,))
    assert SiteSpec.model_validate_json(site.model_dump_json()) == site
