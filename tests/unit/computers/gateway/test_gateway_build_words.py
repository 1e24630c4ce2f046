"""What git, cmake and compilers say, in words for a technician; and how many compilers a small memory takes."""

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_make import jobs_within
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_messages import (
    BuildTrouble,
    CardFull,
    about_building,
    about_git,
    error_lines,
    trouble,
)

URL = "https://gitlab.example.org/c4i/library.git"
REFUSED = f"fatal: Authentication failed for '{URL}/'"
ASKED = "fatal: could not read Username for 'https://gitlab.example.org': terminal prompts disabled"
GNUTLS = (
    f"fatal: unable to access '{URL}/': server certificate verification failed. CAfile: none CRLfile: none",
    f"fatal: unable to access '{URL}/': SSL certificate problem: certificate is not yet valid",
)


@pytest.mark.parametrize(
    ("said", "kind"),
    [
        (REFUSED, BuildTrouble.TOKEN),
        (ASKED, BuildTrouble.TOKEN),
        *((one, BuildTrouble.CERTIFICATE) for one in GNUTLS),
        (f"remote: Not Found\nfatal: repository '{URL}/' not found", BuildTrouble.NOT_FOUND),
        ("fatal: couldn't find remote ref refs/tags/v9", BuildTrouble.REVISION),
        (f"fatal: remote error: upload-pack: not our ref {'f' * 40}", BuildTrouble.REVISION),
        ("fatal: No url found for submodule path 'msgs' in .gitmodules", BuildTrouble.SUBMODULE),
        ("fatal: write error: No space left on device\nfatal: index-pack failed", BuildTrouble.SPACE),
        ("fatal: unable to access 'https://x/': Could not resolve host: x", BuildTrouble.LINK),
        ("error: RPC failed; curl 56 Recv failure\nfatal: the remote end hung up unexpectedly", BuildTrouble.LINK),
        (
            "error: object file .git/objects/aa/bb is empty\nfatal: loose object aabb is corrupt",
            BuildTrouble.CORRUPTION,
        ),
        ("fatal: something else", BuildTrouble.OTHER),
    ],
)
def test_git_failures_are_distinguished(said: str, kind: BuildTrouble) -> None:
    assert trouble(said) is kind
    told = about_git(said, URL, "v1.0.0", has_token=True)
    assert told.message
    assert "Traceback" not in told.message


def test_missing_and_wrong_token_are_distinguished() -> None:
    assert (
        "requires a token for https://gitlab.example.org/c4i/library.git, and the inventory has none"
        in about_git(ASKED, URL, "v1", has_token=False).message
    )
    assert "does not accept the inventory's token for" in about_git(REFUSED, URL, "v1", has_token=True).message
    assert "gateway's clock" in about_git(GNUTLS[1], URL, "v1", has_token=True).hint


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (
            '  Could not find a package configuration file provided by\n  "yaml-cpp" with any of',
            "cmake needs `yaml-cpp`",
        ),
        ("a.cpp:1:10: fatal error: yaml-cpp/yaml.h: No such file or directory", "the header yaml-cpp/yaml.h"),
        (
            "c++: fatal error: Killed signal terminated program cc1plus",
            "the gateway does not have enough memory to build",
        ),
        ("x.s: Assembler messages: fatal error: can't write: No space left on device", "became full"),
        ("a.cpp:3:1: error: 'x' was not declared", "a.cpp:3:1: error"),
    ],
)
def test_build_failures_name_what_is_missing(said: str, words: str) -> None:
    told = about_building("the library", f"-- Configuring\n{said}\nmake: *** [Makefile:2: all] Error 2\n")
    assert words in told.message
    assert isinstance(told, CardFull) == ("full" in words)


def test_relevant_error_lines_are_selected() -> None:
    said = (
        "[ 50%] Building\nx.cpp:2: error: no\nmake[1]: *** [x.o] Error 1\nFailed   <<< pkg [1s, exited with code 2]\n"
    )
    assert error_lines(said) == "x.cpp:2: error: no"
    assert error_lines("one\n\ntwo\n") == "one\ntwo"


@pytest.mark.parametrize(
    ("free_mib", "cores", "wanted", "jobs"),
    [(3600, 6, None, 3), (900, 6, None, 1), (0, 6, None, 1), (16000, 6, None, 6), (16000, 6, 2, 2), (1300, 6, 4, 1)],
)
def test_number_of_jobs_fits_free_memory(free_mib: int, cores: int, wanted: int | None, jobs: int) -> None:
    assert jobs_within(f"MemTotal: 1 kB\nMemAvailable: {free_mib * 1024} kB\n", cores, wanted) == jobs
