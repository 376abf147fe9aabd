# What the demonstrations iocBoot/ioc*/demo have in common; they source this file (bash).
#
#   demo_begin <program> <prefix>      finds the IOC and the CA tools, chooses ports; $P, $tmp
#   start_plc <name> <orders> <file>   starts plcSim; <orders> is a pipe with console commands,
#       [option ...]                   or /dev/null; options of plcSim
#   start_ioc                          starts st.cmd in $here; its shell waits for demo_end
#   demo_end                           "demo ok" and status 0; on a terminal the shell instead,
#                                      after the hints on stdin
#   fail, try, value, has              see below
#
# On a terminal the IOC shell stays at the end; otherwise nothing waits for a person. No
# process is left behind.

demo_begin() {
    top=$(cd "$here/../.." && pwd)
    ioc=$(ls "$top"/bin/*/"$1" 2>/dev/null | head -n 1)
    [ -n "$ioc" ] && [ -e "$here/envPaths" ] || {
        echo "demo: bin/*/$1 or envPaths is not there; type make first" >&2
        exit 1
    }
    bin=${ioc%/*}
    local base
    base=$(sed -n 's/^EPICS_BASE *= *//p' "$top/configure/RELEASE.local" 2>/dev/null)
    PATH=${base:-${EPICS_BASE:-}}/bin/${bin##*/}:$PATH
    command -v caget >/dev/null || {
        echo "demo: no caget: EPICS Base at \"$base\" has no CA tools" >&2
        exit 1
    }
    export P=$2
    tmp=$(mktemp -d)
    children=
    logs=
    trap demo_finish EXIT
    trap 'exit 130' INT TERM
    if [ -t 0 ] && [ -t 1 ]; then terminal=1; else terminal=; fi
    # What the caller's environment says of CA and PVA is for other IOCs.
    local foreign
    had_port=${EPICS_CA_SERVER_PORT:-}
    foreign=$(compgen -e EPICS_CA; compgen -e EPICS_PVA)
    [ -z "$foreign" ] || unset $foreign
    # Ports of our own: other IOCs and other users of this machine are not disturbed. On a
    # terminal the usual ones, so that a plain caget in another window finds the PVs.
    export EPICS_CA_ADDR_LIST=127.0.0.1 EPICS_CA_AUTO_ADDR_LIST=NO
    if [ -z "$terminal" ]; then
        local port=$((10000 + $$ % 2500 * 4)) # none that the system gives to a connection
        export EPICS_CA_SERVER_PORT=$port EPICS_CA_REPEATER_PORT=$((port + 1))
        export EPICS_PVA_SERVER_PORT=$((port + 2)) EPICS_PVA_BROADCAST_PORT=$((port + 3))
        export EPICS_CAS_INTF_ADDR_LIST=127.0.0.1 EPICS_PVAS_INTF_ADDR_LIST=127.0.0.1
    fi
    # Would be started by the first caget, and stay.
    if command -v caRepeater >/dev/null; then
        caRepeater >/dev/null 2>&1 </dev/null &
        children="$children $!"
    fi
    mkfifo "$tmp/hold" "$tmp/orders"
    exec 4<>"$tmp/hold" 5<>"$tmp/orders" # for reading too: does not wait for the reader
}

demo_finish() {
    exec 4>&- 5>&-
    [ -z "$children" ] || kill $children 2>/dev/null
    wait
    rm -rf "$tmp"
}

fail() {
    local log
    echo "demo failed: $*" >&2
    for log in $logs; do
        echo "--- $log" >&2
        tail -n 20 "$tmp/$log.log" >&2
    done
    exit 1
}

# Runs a command again until it succeeds, for some 30 s at most.
try() {
    local end=$((SECONDS + 30))
    until "$@"; do
        [ $SECONDS -lt $end ] || return 1
        sleep 0.1
    done
}

value() { caget -w 20 -t "$P$1" 2>/dev/null; }

has() { [ "$(value "$1")" = "$2" ]; }

# The port on which a simulated PLC listens.
port_of() { sed -n 's/.*listening on .*:\([0-9]*\)$/\1/p' "$tmp/$1.log" | head -n 1; }

# The same of its Modbus server.
modbus_port_of() { sed -n 's/.*Modbus listening on .*:\([0-9]*\)$/\1/p' "$tmp/$1.log" | head -n 1; }

start_plc() {
    local stdin= name=$1 orders=$2 file=$3
    shift 3
    [ "$orders" != /dev/null ] || stdin=--no-stdin
    : >"$tmp/$name.log" # the line that waits below may be sooner than plcSim
    "$bin/plcSim" $stdin --port 0 "$@" --console "$tmp/$name.sock" "$file" \
        >"$tmp/$name.log" 2>&1 4>&- 5>&- <"$orders" &
    children="$children $!"
    logs="$logs $name"
    try grep -q 'console on' "$tmp/$name.log" || fail "the simulated PLC $name does not start"
}

# The IOC reads st.cmd, then `hold` until we let it go on to its shell.
start_ioc() {
    cd "$here" || exit 1
    : >"$tmp/ioc.log"
    if [ -n "$terminal" ]; then
        "$ioc" st.cmd "$tmp/hold" <&0 4>&- 5>&- &
    else
        "$ioc" st.cmd "$tmp/hold" </dev/null >"$tmp/ioc.log" 2>&1 4>&- 5>&- &
    fi
    iocpid=$!
    children="$children $iocpid"
    logs="$logs ioc"
}

demo_end() {
    if [ -z "$terminal" ]; then
        exec 4>&-
        ioc_ended() { ! kill -0 "$iocpid" 2>/dev/null; }
        try ioc_ended || fail "the IOC does not end"
        wait "$iocpid" || fail "the IOC ended with status $?"
        echo "demo ok"
        exit 0
    fi
    echo "Try in another window:"
    echo "    export PATH=$(dirname "$(command -v caget)"):\$PATH EPICS_CA_ADDR_LIST=127.0.0.1 EPICS_CA_AUTO_ADDR_LIST=NO"
    [ -z "$had_port" ] || echo "    unset EPICS_CA_SERVER_PORT"
    echo "    phoebus -resource 'file:$top/op/bob/plclinkOverview.bob'   all PLCs (docs/displays.md)"
    cat
    exec 4>&-
    wait "$iocpid"
}
