"""Secrets are where they belong and nowhere else: every process' arguments and environment, every output, every file.

The passphrase, the CA's key, the keys of members and of the server, and the one-time passphrases are looked for in what
the commands have started, said and written, and in what is left. strace tells of the processes and of the modes.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pyrage
import pytest
from live_stand import Record, Server
from vpn_desk import over_a_pipe

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn.authority.authority import Authority, unseal_ca
from atlantis_netcfg.vpn.enrolment_package import open_package
from atlantis_netcfg.vpn.pki import key_pem

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

ROOT = Path(__file__).parents[4]
PASSPHRASE = "canary-2f9d41-heron-under-glass"
DRIVER = Path(__file__).with_name("canary_driver.py")
KEY = pyrage.x25519.Identity.generate()
SELDOM = {
    *(".git", ".venv", ".venv-strangers", ".mypy_cache", ".ruff_cache", ".pytest_cache"),
    *("__pycache__", ".hypothesis"),
}
LOOSE = 0o077
CALLS = "trace=execve,openat,mkdir,chmod,fchmod,fchmodat"


class Scene:
    """One computer of an operator: home, state, temporary folder, a stick; and what strace has seen on it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.authority = folder / "state" / "vpn"
        for name in ("home", "tmp", "stick", "state"):
            (folder / name).mkdir(mode=0o700)
        self.key = folder / "home" / "age.key"
        self.key.touch(0o600)
        self.key.write_text(f"# canary\n{KEY}\n")
        self.environment = {
            "PATH": os.environ["PATH"],
            "HOME": str(folder / "home"),
            "TMPDIR": str(folder / "tmp"),
            "ATLANTIS_STATE": str(folder / "state"),
            "PYTHONPATH": str(ROOT),
            "LANG": "C.UTF-8",
        }
        self.said = ""
        self.traced = ""

    def type(self, server: int, *lines: Sequence[str]) -> None:
        """Type them under strace; `PASS` stands for a descriptor with the passphrase."""
        with ExitStack() as stack:
            numbers = [stack.enter_context(over_a_pipe(PASSPHRASE)) for _ in lines]
            typed = [
                ["vpn", *(f"--passphrase-fd={number}" if word == "PASS" else word for word in line), self.where]
                for line, number in zip(lines, numbers, strict=True)
            ]
            (self.folder / "lines.json").write_text(json.dumps(typed))
            trace = self.folder.parent / "trace"
            strace = ("strace", "-f", "-y", "-v", "-s", "1000000", "-o", str(trace))
            done = subprocess.run(
                [*strace, "-e", CALLS, sys.executable, str(DRIVER), str(self.folder / "lines.json"), str(server)],
                env=self.environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                pass_fds=[int(number) for number in numbers],
                check=False,
            )
        assert done.returncode == 0, done.stderr
        self.said += done.stdout + done.stderr
        self.traced += trace.read_text(errors="replace")

    @property
    def where(self) -> str:
        return f"authority={self.authority}"


def pieces(text: str) -> Iterator[str]:
    """Every line of every key in it; of a short key the third is its public half, as in the certificate."""
    for kind, body in re.findall(
        r"-----BEGIN ([^-\n]*(?:PRIVATE KEY|key[^-\n]*))-----\n(.*?)\n-----END", text, re.DOTALL
    ):
        lines = body.split("\n")
        yield from lines[:2] if kind == "PRIVATE KEY" and len(lines) == 3 else lines


def keys(scene: Scene) -> dict[str, str]:
    """Every secret of the scene, by what it is."""
    ca = unseal_ca(scene.authority, Secret(PASSPHRASE))
    found = {"passphrase": PASSPHRASE, "age key": str(KEY)}
    texts = {"CA": key_pem(ca.key).reveal()}
    for path in [*scene.authority.glob("server/*.key"), *scene.authority.glob("hosts/*.identity")]:
        texts[path.name] = path.read_text()
    for path in scene.authority.glob("handouts/*/*.age"):
        for one in [str(KEY), *passphrases(scene)]:
            try:
                files = open_package(path.read_bytes(), Secret(one))
            except Exception:  # noqa: BLE001, S112 - sealed for somebody else
                continue
            texts[path.name] = next(iter(files.values()))
            break
        else:
            pytest.fail(f"nothing opens {path}")
    for name, text in texts.items():
        found |= {f"{name} {number}": piece for number, piece in enumerate(pieces(text))}
    return found


def passphrases(scene: Scene) -> list[str]:
    return re.findall(r"\b(?:[0-9]{5}-){4}[0-9]{5}\b", scene.said)


def holding(secrets: dict[str, str], *folders: Path) -> list[str]:
    """The files that hold one of the secrets, with what."""
    found = []
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.is_symlink() or not path.is_file() or SELDOM & set(path.relative_to(folder).parts):
                continue
            text = path.read_bytes()
            found += [f"{path}: {name}" for name, secret in secrets.items() if secret.encode() in text]
    return found


def scanned(scene: Scene, server: Server) -> None:
    """Raise what is where it must not be."""
    secrets, told = keys(scene), passphrases(scene)
    assert len(secrets) > 20
    assert len(set(told)) == len(told) >= 1, "each one-time passphrase is told once"
    assert [name for name, secret in secrets.items() if secret in scene.traced] == []
    assert [one for one in told if one in scene.traced] == []
    assert [name for name, secret in secrets.items() if secret in scene.said] == []

    once = {f"one-time {number}": one for number, one in enumerate(told)}
    left = holding(secrets | once, scene.folder)
    homes = (str(scene.authority / "hosts"), str(scene.authority / "server"), f"{scene.key}: age key")
    assert [one for one in left if not one.startswith(homes)] == []
    assert len({one.partition(":")[0] for one in left}) >= 4
    for one in left:
        assert Path(one.partition(":")[0]).stat().st_mode & LOOSE == 0, one
    # Of the checkout everything but what other tests may be writing; the test itself names its passphrase.
    tree = (path for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith("."))
    assert holding({**secrets, **once}, *tree) == [
        f"{ROOT}/tests/integration/vpn/live/test_vpn_canaries.py: passphrase"
    ]
    its_own = "".join(path.read_text() for path in scene.authority.glob("server/*.key"))
    ours = {name: secret for name, secret in secrets.items() if secret not in its_own}
    assert holding(ours | once, *(server.at(path) for path in ("/run", "/etc/openvpn", "/var/lib/atlantis"))) == []


def loose(scene: Scene) -> list[str]:
    """What was made in the authority and on the stick so that others could read it, be it for a moment."""
    place = r'(?:AT_FDCWD|[0-9]+)<([^>]*)>, "([^"]+)"'
    made = re.findall(rf"openat\({place}, [A-Z_|]*O_CREAT[A-Z_|]*, (0[0-7]*)\) = [0-9]", scene.traced)
    made += re.findall(rf"fchmodat\({place}, (0[0-7]*)", scene.traced)
    made += re.findall(r'()\b(?:mkdir|chmod)\("([^"]+)", (0[0-7]*)', scene.traced)
    made += re.findall(r"()fchmod\([0-9]+<([^>]+)>, (0[0-7]*)", scene.traced)
    paths = [(os.path.join(folder, path), mode) for folder, path, mode in made]  # noqa: PTH118 - as the kernel joins them
    inside = (str(scene.authority), str(scene.folder / "stick"))
    here = [(path, mode) for path, mode in paths if path.startswith(inside)]
    assert len(here) > 40  # or strace is not understood
    return [f"{path} {mode}" for path, mode in here if int(mode, 8) & LOOSE]


@pytest.mark.parametrize("how", ["age", pytest.param("vault", marks=pytest.mark.campaign)])
def test_secrets_are_only_where_they_belong(how: str, tmp_path: Path) -> None:
    (tmp_path / "scene").mkdir(mode=0o700)
    scene = Scene(tmp_path / "scene")
    scene.type(0, ["init", f"sealed={how}", "PASS"])
    with ExitStack() as stack:
        server = Server(stack, Record(Authority.open(scene.authority)))
        server.push()
        server.start()
        scene.type(
            server.pid,
            ["init", f"sealed={how}"],
            ["onboard", "partner=iqua", "device=sparus2", "kind=robot", f"to={scene.folder / 'stick'}", "PASS"],
            [
                "onboard",
                "partner=iqua",
                "device=laptop",
                "kind=laptop",
                f"recipient={KEY.to_public()}",
                "PASS",
                "--json",
            ],
            ["onboard", "device=coastal-gateway", f"recipient={KEY.to_public()}", "PASS"],
            ["onboard", "partner=eca", "device=lost", "kind=laptop", "PASS", "CRASH"],
            ["renew", "name=iqua-laptop", f"recipient={KEY.to_public()}", "PASS"],
            ["status"],
            ["show", "name=iqua-sparus2", "--json"],
            ["accept", f"file={scene.authority}/handouts/coastal-gateway/coastal-gateway.tar.age", f"key={scene.key}"],
            ["revoke", "name=iqua-sparus2", "--yes", "PASS"],
            ["sync"],
            ["audit"],
        )
        codes = re.findall(r"^exit (\d)$", scene.said, re.MULTILINE)
        assert codes == [*"00000", "1", *"0000000"], scene.said
        scanned(scene, server)
    assert loose(scene) == []
