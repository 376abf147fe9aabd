#!/bin/sh
# Makes the machine ready to build plclink. Called by the top Makefile, not by hand.
#
#   configure/setup.sh base    find or build EPICS Base, write configure/RELEASE.local
#   configure/setup.sh named   print the EPICS Base that a RELEASE file or the environment names
#   configure/setup.sh release write EPICS_BASE from the environment into configure/RELEASE.local
#   configure/setup.sh map     what plcmap needs: Python
#   configure/setup.sh python  make the Python environment of the system tests, print its path
#   configure/setup.sh check   what tests/check/run needs: clang, clang-tidy, cppcheck
#   configure/setup.sh docs    the same of the tools for the documents
#   configure/setup.sh fuzz    what tests/fuzz/run needs: clang with libFuzzer
#   configure/setup.sh machines  what tests/check/machines needs: cross compilers and qemu
#   configure/setup.sh coverage  the same of what tests/coverage needs
#   configure/setup.sh displays  the same for pictures of displays (tests/displays/run)
#
# Debian 12 and 13. What is there already is used; nothing is downloaded twice. Everything
# that is built goes to a cache outside the tree: $PLCLINK_CACHE, default ~/.cache/plclink.
set -eu

cd "$(dirname "$0")/.."
cache=${PLCLINK_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/plclink}
# The recipe's version is part of the name, so that a changed recipe builds a new Base.
recipe=1

say() { printf 'plclink setup: %s\n' "$*" >&2; }
die() { say "$*"; exit 1; }

# Installs the Debian packages that are missing; silent when none is.
packages() {
    missing=
    for p in "$@"; do
        dpkg-query -W -f '${Status}' "$p" 2>/dev/null | grep -q 'ok installed' ||
            missing="$missing $p"
    done
    [ -n "$missing" ] || return 0
    command -v apt-get >/dev/null ||
        die "needs the equivalent of these Debian packages, and finds no apt-get:$missing"
    root=
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null ||
            die "not root and no sudo. Ask an administrator for: apt-get install$missing"
        root=sudo
    fi
    say "installing$missing"
    log=$(mktemp)
    if ! { $root apt-get update && $root env DEBIAN_FRONTEND=noninteractive \
           apt-get install -y --no-install-recommends $missing; } >"$log" 2>&1; then
        cat "$log" >&2
        die "apt-get could not install:$missing"
    fi
    rm -f "$log"
}

# True when $1 is a built EPICS Base of version 7.0 or newer.
is_base() {
    [ -n "$1" ] && [ -r "$1/configure/CONFIG_BASE_VERSION" ] || return 1
    grep -Eq '^EPICS_VERSION *= *([7-9]|[1-9][0-9])' "$1/configure/CONFIG_BASE_VERSION" || return 1
    ls "$1"/lib/*/libdbCore.* >/dev/null 2>&1
}

# Downloads the newest EPICS Base source that Debian has into the current directory. The
# sources list is derived from the machine's own, so it asks the mirror this machine asks.
fetch_base_source() {
    private=$PWD/apt
    mkdir -p "$private/lists/partial" "$private/cache/archives/partial"
    cat /etc/apt/sources.list.d/*.sources 2>/dev/null | awk 'BEGIN { RS = ""; ORS = "\n\n" }
        /debian-archive/ && !/-security/ && !done { done = 1; print }' |
        sed -e 's/^Types:.*/Types: deb-src/' -e 's/^Suites:.*/Suites: trixie/' \
            -e 's/^Components:.*/Components: main/' >"$private/base.sources"
    if ! [ -s "$private/base.sources" ]; then
        awk '$1 == "deb" && !/security/ && / main/ {
            sub(/^deb/, "deb-src"); for (i = 2; i <= NF; i++)
                if ($i ~ /^(bookworm|trixie|stable)$/) { $i = "trixie"; print; exit } }' \
            /etc/apt/sources.list >"$private/base.list" 2>/dev/null || :
    fi
    list=$(ls "$private"/base.sources "$private"/base.list 2>/dev/null |
        while read -r f; do [ ! -s "$f" ] || echo "$f"; done | head -n 1)
    [ -n "$list" ] || die "no Debian mirror in /etc/apt to take EPICS Base from." \
        "Set EPICS_BASE in configure/RELEASE.local to a Base of your own."
    chmod -R a+rX "$private"
    apt="-o Dir::Etc::sourcelist=$list -o Dir::Etc::sourceparts=/dev/null
         -o Dir::State::lists=$private/lists -o Dir::Cache=$private/cache
         -o APT::Sandbox::User=root"
    apt-get $apt update && apt-get $apt source --tar-only epics-base/trixie
}

# Builds EPICS Base into $1: libcom, ca, database, pvData, pvAccess, normativeTypes, QSRV.
build_base() {
    say "building EPICS Base into $1 (once, some minutes; what it does: $1.log) ..."
    packages build-essential perl libreadline-dev dpkg-dev xz-utils ca-certificates debian-archive-keyring
    mkdir -p "$1.work"
    (
        cd "$1.work"
        fetch_base_source
        tar xf epics-base_*.orig.tar.*
        # The tree is built where it stays: EPICS writes absolute paths into its libraries.
        rm -rf "$1"
        mv base-* "$1"
        cd "$1"
        sed -i -E '/^SUBMODULES \+= (pvaClient|pvDatabase)/d' modules/Makefile
        find modules -maxdepth 2 -name Makefile -exec sed -i -E \
            '/^ *DIRS *\+= *(test|testApp|testCa|examples?|runTestServer|documentation)\b/d' {} +
        unset MAKEFLAGS MAKELEVEL MFLAGS MAKEOVERRIDES TOP EPICS_BASE EPICS_HOST_ARCH
        make -j"$(nproc)"
    ) >"$1.log" 2>&1 || { tail -n 30 "$1.log" >&2; die "EPICS Base did not build: $1.log"; }
    rm -rf "$1.work"
    find "$1" -name 'O.*' -type d -prune -exec rm -rf {} +
    is_base "$1" || die "EPICS Base did not build: $1.log"
    touch "$1/.complete"
}

base() {
    packages build-essential perl libmodbus-dev pkg-config
    for b in "${EPICS_BASE:-}" /usr/lib/epics; do
        if is_base "$b"; then write_release "$b"; return; fi
    done
    [ -z "${EPICS_BASE:-}" ] || die "EPICS_BASE=$EPICS_BASE is no built EPICS Base >= 7.0."
    # Debian 13 packages Base's libraries (epics-dev), but not its build system.
    b=$cache/epics-base-7-$(uname -m)-r$recipe
    mkdir -p "$cache"
    (
        flock 9
        [ -e "$b/.complete" ] || build_base "$b"
    ) 9>"$cache/lock" || exit 1
    write_release "$b"
}

# What make reads; nothing where no Base is named.
named() {
    printf 'TOP = .\ninclude configure/RELEASE\nnamed: ; @echo $(EPICS_BASE)\n' |
        make -s --no-print-directory -f - named
}

write_release() {
    say "using EPICS Base in $1"
    printf '# Written by configure/setup.sh. Edit at will: it is not overwritten.\nEPICS_BASE = %s\n' \
        "$1" >configure/RELEASE.local.new
    mv configure/RELEASE.local.new configure/RELEASE.local
}

# Makes the Python environment $1 from the requirements file $2, prints its path.
environment() {
    want=$(cksum <"$2" | cut -d' ' -f1)
    venv=$cache/$1-$(python3 -c 'import sys; print("%d.%d" % sys.version_info[:2])')-$want
    mkdir -p "$cache"
    (
        flock 9
        if ! [ -e "$venv/.complete" ]; then
            say "making a Python environment from $2 in $venv"
            python3 -m venv --clear "$venv" &&
                "$venv/bin/pip" install -q --disable-pip-version-check -r "$2" >&2 &&
                touch "$venv/.complete"
        fi
    ) 9>"$cache/lock" || die "pip could not install $2"
    echo "$venv"
}

python() {
    packages python3-venv mbpoll iproute2 iptables iputils-ping procps procserv
    environment venv tests/requirements.txt
}

check() {
    # gcc's packages bring its sanitizers.
    packages build-essential clang clang-tidy cppcheck
}

documents() {
    packages python3-venv
    environment docs docs/requirements.txt
}

displays() {
    packages python3-venv xvfb xauth fonts-liberation libgl1 libegl1 libdbus-1-3 libfontconfig1 \
        libxkbcommon-x11-0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-randr0 \
        libxcb-render-util0 libxcb-shape0 libxcb-xinerama0 libxcb-cursor0
    environment displays tests/displays/requirements.txt
}

fuzz() {
    packages build-essential python3 libmodbus-dev clang llvm libclang-rt-dev
}

coverage() {
    packages build-essential python3-venv
    environment coverage tests/coverage/requirements.txt
}

machines() {
    packages build-essential qemu-user-static g++-powerpc-linux-gnu g++-s390x-linux-gnu \
        g++-arm-linux-gnueabihf
}

case ${1:-} in
    base) base ;;
    machines) machines ;;
    fuzz) fuzz ;;
    map) packages python3 ;;
    named) named ;;
    release) write_release "$EPICS_BASE" ;;
    python) python ;;
    check) check ;;
    coverage) coverage ;;
    docs) documents ;;
    displays) displays ;;
    *) die "usage: configure/setup.sh base|map|named|release|python|check|coverage|docs|fuzz|machines|displays" ;;
esac
