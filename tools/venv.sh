# shellcheck shell=sh disable=SC2154 # `root` is the caller's
# Makes .venv and keeps it complete; sourced by ./provision and tools/develop, which set `root` to the checkout.
#
# A stamp inside .venv says for which pyproject.toml, lock files, Python and place it was completed. When the stamp
# fits, nothing is called and no network is touched. The mark `.venv-setup/making` stands from before the first change
# of .venv until after the last: an environment that was interrupted is never taken for a complete one.

venv=$root/.venv
setup=$root/.venv-setup
log=$setup/log

say() { printf '%s\n' "$*" >&2; }

# start_ticking: from now on `doing WORDS` is shown with the seconds that have passed, each second on a terminal and every 30
# in a log, so that nobody takes a slow download for a computer that hangs.
start_ticking() {
    ticking_since=$(date +%s)
    : >"$setup/doing"
    (
        step=30
        [ ! -t 2 ] || step=1
        while sleep "$step" >/dev/null 2>&1 && kill -0 "$$" 2>/dev/null; do
            IFS= read -r words <"$setup/doing" || continue
            passed=$(($(date +%s) - ticking_since))
            if [ -t 2 ]; then printf '\r%s, %s s \033[K' "$words" "$passed" >&2; else say "$words, $passed s"; fi
        done
    ) 9>&- & # its `sleep` outlives it, and would hold the lock
    ticker=$!
}

stop_ticking() {
    [ -n "${ticker:-}" ] || return 0
    kill "$ticker" 2>/dev/null
    wait "$ticker" 2>/dev/null
    ticker=
    [ ! -t 2 ] || printf '\r\033[K' >&2
}

doing() { [ -z "${ticker:-}" ] || printf '%s\n' "$1" >"$setup/doing"; }

# give_up MESSAGE [HINT...]: what is wrong with this machine, and what to type. Exit code 3 of docs/exit-codes.md.
give_up() {
    stop_ticking
    say "error: $1"
    shift
    for hint in "$@"; do say "       $hint"; done
    exit 3
}

# Nothing of the caller's Python reaches ours: a module path or an option of theirs would break it.
shield_python() {
    unset PYTHONHOME PYTHONPATH PYTHONSTARTUP PYTHONINSPECT PYTHONOPTIMIZE PYTHONWARNINGS PYTHONPLATLIBDIR \
        PYTHONUSERBASE PYTHONCASEOK PYTHONDEVMODE PYTHONEXECUTABLE VIRTUAL_ENV
}

# Of pip's settings only those that say where packages come from are the machine's business.
shield_pip() {
    for name in $(env | sed -n 's/^\(PIP_[A-Z_]*\)=.*/\1/p'); do
        case $name in
            PIP_INDEX_URL | PIP_EXTRA_INDEX_URL | PIP_FIND_LINKS | PIP_NO_INDEX | PIP_TRUSTED_HOST | PIP_CONFIG_FILE) ;;
            PIP_CERT | PIP_CLIENT_CERT | PIP_PROXY | PIP_TIMEOUT | PIP_DEFAULT_TIMEOUT | PIP_RETRIES) ;;
            PIP_CACHE_DIR | PIP_NO_CACHE_DIR | PIP_KEYRING_PROVIDER) ;;
            *) unset "$name" ;;
        esac
    done
    export PIP_USER=0 PIP_REQUIRE_HASHES=0 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1 PIP_NO_COLOR=1
}

# stamp: what .venv would have to be complete for, one line each.
stamp() {
    cat "$root/pyproject.toml" "$root"/requirements/*.txt | cksum
    readlink -f "$venv/bin/python"
    printf '%s\n' "$root"
}

# is_complete EXTRA: whether .venv was completed for this EXTRA (`run`, or `dev` for the tests) and nothing changed since.
is_complete() {
    [ -f "$venv/$1.stamp" ] && [ -r "$venv/$1.stamp" ] && [ ! -e "$setup/making" ] && [ -x "$venv/bin/python" ] &&
        [ "$(cat "$venv/$1.stamp")" = "$(stamp)" ]
}

# prepare EXTRA: make .venv complete, alone, saying so step by step.
prepare() {
    is_complete "$1" && return
    if ! mkdir -p "$setup" 2>/dev/null || ! [ -w "$setup" ] || ! [ -w "$root" ]; then
        give_up "$venv is not complete for you, and $root cannot be written by $(id -un 2>/dev/null || id -u)" \
            "let its owner start ./provision once, or make a clone of your own"
    fi
    shield_pip
    if command -v flock >/dev/null; then
        exec 9>"$setup/lock"
        flock -n 9 || { say "another start is setting up .venv; waiting for it" && flock 9; }
    fi
    trap 'stop_ticking; say "stopped; the next start goes on from here"; exit 4' INT TERM HUP
    is_complete "$1" || build "$1"
    trap - INT TERM HUP
    exec 9>&-
}

build() {
    began=$(date +%s)
    : >"$log"
    start_ticking
    if usable_venv; then
        renew "$1"
    else
        anew "$1"
    fi
    stop_ticking
    stamp >"$venv/$1.stamp"
    [ "$1" = run ] || cp "$venv/$1.stamp" "$venv/run.stamp"
    rm -f "$setup/making"
    say "[4/4] ready after $(($(date +%s) - began)) s; from now on no network is needed to start"
}

usable_venv() {
    [ ! -e "$setup/making" ] && [ -x "$venv/bin/python" ] &&
        "$venv/bin/python" -I -c 'import sys, pip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

anew() {
    say "Setting up .venv in $root: once, and with the package index within reach"
    find_python
    say "[1/4] Python: $python, version $version"
    [ ! -e "$venv" ] || say "      the .venv that is there is not complete: making it anew"
    : >"$setup/making"
    rm -rf "$venv"
    say "[2/4] environment: .venv"
    doing "      making it"
    "$python" -I -m venv "$venv" >>"$log" 2>&1 || pip_failed "the environment could not be made"
    install_packages "$1" || pip_failed "the packages could not be installed"
}

# renew EXTRA: .venv is whole, but for other pins, another extra, or another place.
renew() {
    say "Bringing .venv up to date with this checkout"
    say "[1/4] Python: as it is"
    previous=$(sed -n 3p "$venv/run.stamp" 2>/dev/null)
    : >"$setup/making"
    if [ -n "$previous" ] && [ "$previous" != "$root" ]; then
        say "[2/4] environment: the checkout was moved from $previous"
        "$venv/bin/python" -I "$root/tools/move_venv.py" "$previous" "$root" >>"$log" 2>&1 ||
            pip_failed "the environment could not be moved"
        rm -f "$venv"/*.stamp
    else
        say "[2/4] environment: as it is"
    fi
    install_packages "$1" && return
    rm -f "$setup/making" # pip looks for all packages before it changes one: what was there still is
    pip_failed "the packages could not be brought up to date"
}

# install_packages EXTRA: what the lock file lists, each file as its SHA-256 says and none built here; then the checkout, by
# the setuptools that is among them.
install_packages() {
    say "[3/4] packages: fetching"
    doing "      fetching"
    pip --require-hashes --only-binary :all: --requirement "$root/requirements/$1.txt" &&
        pip --no-deps --no-build-isolation --editable "$root"
}

# pip WORD...: install, counting aloud; all it says is in the log.
pip() {
    {
        "$venv/bin/python" -I -m pip install --progress-bar off "$@" </dev/null 2>&1
        echo "exit $?"
    } | {
        count=0
        status=1
        while IFS= read -r line; do
            printf '%s\n' "$line" >>"$log"
            case $line in
                "exit "*) status=${line#exit } ;;
                "Collecting "* | "Processing "*)
                    count=$((count + 1))
                    doing "      fetching, $count packages so far"
                    ;;
                "Installing collected packages: "*,*)
                    [ ! -t 2 ] || printf '\r\033[K' >&2
                    say "[3/4] packages: installing $count"
                    doing "      installing $count packages"
                    ;;
            esac
        done
        return "$status"
    }
}

pip_failed() {
    if grep -q 'CERTIFICATE_VERIFY_FAILED' "$log"; then
        say "error: the package index cannot prove who it is; is the clock right? here it is $(date)"
    elif grep -q -e 'Retrying (' -e 'NewConnectionError' "$log"; then
        say "error: the package index does not respond"
    else
        grep -i '^error' "$log" | tail -n 3 >&2
    fi
    give_up "$1; all that was said is in $log" \
        "is the package index within reach? connect once, or set PIP_INDEX_URL (a mirror) or PIP_NO_INDEX=1 with" \
        "PIP_FIND_LINKS (a folder of wheels), then start again"
}

# find_python: sets `python` and `version`; the distribution's own first, since every user of the machine can run it.
find_python() {
    look_for_python && return
    install_system_packages "$package" && look_for_python && return
    if [ -n "$lacking" ]; then
        give_up "$lacking cannot make environments: the package $package is missing" \
            "type: sudo apt-get install -y $package"
    fi
    give_up "Python 3.11 or newer is needed" "type: sudo apt-get install -y $package"
}

look_for_python() {
    lacking=
    package=python3-venv
    set -- /usr/bin/python3 python3 python3.13 python3.12 python3.11 python3.14
    [ -z "${ATLANTIS_PYTHON:-}" ] || set -- "$ATLANTIS_PYTHON"
    for candidate in "$@"; do
        path=$(command -v "$candidate") || continue
        case $path in "$venv"/*) continue ;; esac
        answer=$("$path" -I "$root/tools/can_make_venv.py" 2>/dev/null) || continue
        case $answer in
            yes\ *)
                python=$path
                version=${answer#yes }
                return 0
                ;;
            no\ *) lacking=${lacking:-$path} && package=${answer#no } ;;
        esac
    done
    return 1
}

# install_system_packages NAME...: by apt, as root or through sudo; fails where neither is to be had.
install_system_packages() {
    command -v apt-get >/dev/null || return 1
    as=
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null || return 1
        if sudo -n true 2>/dev/null; then
            as="sudo -n"
        elif [ -t 0 ] && [ -t 2 ]; then
            as=sudo
        else
            return 1
        fi
    fi
    say "      installing what this machine lacks, by apt-get: $*"
    doing "      apt-get at work"
    apt_get install -y --no-install-recommends "$@" || { apt_get update && apt_get install -y --no-install-recommends "$@"; }
}

apt_get() {
    $as env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=120 "$@" >>"$log" 2>&1 </dev/null
}
