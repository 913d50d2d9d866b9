#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The case study and the tests on a busy machine: tests/proofs/busy.sh [RUNS] [TEST_RUNS]
# RUNS case studies (default 10) as an ordinary user beside stress-ng, then TEST_RUNS of `make test` (default 3, 0 for none)
# so too; and, where this is run as root, RUNS as root beside a process on each processor that is above ordinary programs
# and below the loops. Exit code 1 where one failed, took more than four times as long as without load, or has a cell
# beyond its limit. Where the ordinary user may not write here, the tests run in a copy with an installation of its own.
# SEGWAY_ECC is the command to run (default .venv/bin/segway-ecc); STUDY what it is given besides (--seat ...); FACTOR how
# many times as long a run may take (default 4); TESTS what runs the tests (default make test).
set -euo pipefail
runs=${1:-10}
test_runs=${2:-3}
factor=${FACTOR:-4}
cd "$(dirname "$0")/../.."
read -ra tool <<< "${SEGWAY_ECC:-$PWD/.venv/bin/segway-ecc}"
read -ra study <<< "${STUDY:-}"
read -ra tests <<< "${TESTS:-make test}"

fail() {
    echo "busy: $1" >&2
    exit 2
}

[[ $runs =~ ^[1-9][0-9]*$ ]] || fail "RUNS is a number, 1 or more, not '$runs'"
[[ $test_runs =~ ^[0-9]+$ ]] || fail "TEST_RUNS is a number, 0 or more, not '$test_runs'"
command -v "${tool[0]}" > /dev/null || fail "no ${tool[0]}: run deploy/setup.sh .venv, or name another in SEGWAY_ECC"
command -v stress-ng > /dev/null || fail "no stress-ng: sudo apt-get install stress-ng"
for needed in setpriv setsid chrt taskset python3; do
    command -v "$needed" > /dev/null || fail "no $needed: sudo apt-get install util-linux python3"
done

# An ordinary user; root lends nobody its own name, nor its home.
user=()
work=$(mktemp -d)
load=()
testing=
if ((EUID == 0)); then
    user=(env USER=busy LOGNAME=busy HOME="$work" setpriv --reuid 65534 --regid 65534 --clear-groups)
    chown 65534:65534 "$work"
    chmod 755 "$work"
fi

end_load() {
    local pid
    for pid in "${load[@]}"; do
        kill -TERM "$pid" 2> /dev/null || true
    done
    for pid in "${load[@]}"; do
        wait "$pid" 2> /dev/null || true
    done
    load=()
}
# shellcheck disable=SC2329 # the trap below calls it
end_tests() {
    [[ -n $testing ]] || return 0
    kill -TERM -- "-$testing" "$testing" 2> /dev/null || true
    wait "$testing" 2> /dev/null || true
}
# Each part of the load and the tests end with this script, even where it is killed: see --pdeathsig.
trap 'end_tests; end_load; rm -rf "$work"' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP

stress() {
    "${user[@]}" mkdir -p "$work/stress"
    "${user[@]}" setpriv --pdeathsig TERM stress-ng --quiet --cpu 4 --io 2 --vm 2 --fork 4 --hdd 2 \
        --temp-path "$work/stress" > /dev/null 2>&1 &
    load+=($!)
}

bursts() {
    local processor
    for processor in $(python3 -c 'import os; print(*os.sched_getaffinity(0))'); do
        taskset -c "$processor" chrt -f 10 setpriv --pdeathsig KILL python3 -c '
import time
while True:
    until = time.monotonic() + 0.9
    while time.monotonic() < until:
        pass
    time.sleep(0.35)' &
        load+=($!)
    done
}

# The worst cell of each seat, m, and what was repeated; exit code 1 where a cell is beyond its limit.
cells() {
    python3 - "$1" << 'END'
import json, sys
found = json.load(open(sys.argv[1], encoding="utf-8"))
limits = {"offline": 0.006, "submodel": 0.006, "ros": 0.006, "can": 0.12}
cells = found["cells"]
seats = [seat for seat in limits if seat in cells[0]]
worst = {s: max(abs(a - b) for c in cells for a, b in zip(c[s], c["offline_20sim"])) for s in seats}
same = all(cell["ros"] == cell["offline"] for cell in cells) if {"ros", "offline"} <= set(seats) else None
good = bool(seats) and same is not False and all(worst[seat] <= limits[seat] for seat in seats)
real = found["real_time"]
timing = real and real["timing"]
if real is None:
    shown = "not run"
elif timing is None:
    _, stalled, length = real["failure"].partition("the machine stalled for ")
    shown = f"no result; {stalled}{length.split(';')[0]}"
else:
    shown = f"worst {timing['lateness_worst_s'] * 1e3:.1f} ms late, {timing['skipped']} skipped, "
    shown += f"stalled {timing['stall_s'] * 1e3:.0f} ms"
bits = [] if same is None else [f"bits of ros and offline {'not ' * (not same)}equal,"]
print(*(f"{seat} {worst[seat]:.4f} m," for seat in seats), *bits,
      f"{len(found['repeated'])} repeats, can in real time: {shown}")
sys.exit(not good)
END
}

# One run: its name, how long it may take (s, or any), and as whom (words that come before the command).
outcome=
seconds=0
run() {
    local out=$work/$1 limit=$2 status=0 begun=$SECONDS figures
    shift 2
    "$@" mkdir -p "$out"
    "$@" env HOME="$out" "${tool[@]}" case-study "${study[@]}" --json --out "$out/study" \
        > "$out.json" 2> "$out.errors" < /dev/null || status=$?
    seconds=$((SECONDS - begun))
    if ((status != 0)); then
        outcome="FAILED with exit code $status: $(grep ', try [0-9]* of ' "$out.errors" || true; tail -n 1 "$out.errors")"
    elif ! figures=$(cells "$out.json"); then
        outcome="BEYOND A LIMIT: $figures"
    elif [[ $limit != any ]] && ((seconds > limit)); then
        outcome="TOO SLOW, more than $limit s: $figures"
    else
        outcome="ok: $figures"
    fi
    rm -rf "$out"
    [[ $outcome == ok:* ]]
}

run quiet any env "${user[@]}" || {
    echo "without load: $outcome"
    exit 1
}
quiet=$seconds
limit=$((factor * (quiet ? quiet : 1)))
echo "without load: $quiet s, $outcome"

failed=0
under() {
    local name=$1 succeeded=0 slowest=0 number
    shift
    for ((number = 1; number <= runs; number++)); do
        run "${name// /_}_$number" "$limit" env "$@" && succeeded=$((succeeded + 1))
        ((seconds <= slowest)) || slowest=$seconds
        echo "$name, run $number: $seconds s, $outcome"
    done
    echo "$name: $succeeded of $runs succeeded, in at most $slowest s (without load: $quiet s)"
    ((succeeded == runs)) || failed=1
}

# The folder in which an ordinary user can run the tests. An installation names its own folder, so a copy has one of its own.
tree=$PWD
prepare_tests() {
    ! "${user[@]}" test -w . || return 0
    tree=$work/tree
    "${user[@]}" mkdir "$tree"
    tar --exclude='./.venv*' --exclude=./build --exclude=./out --exclude='.*_cache' --exclude=.hypothesis \
        --exclude=__pycache__ --exclude='*.egg-info' -cf - . | "${user[@]}" tar -C "$tree" -xf -
    "${user[@]}" make -C "$tree" .venv/.ready > "$work/set-up.log" 2>&1 ||
        fail "cannot set up a copy for the tests: $(tail -n 1 "$work/set-up.log")"
}

tests_under() {
    local name=$1 succeeded=0 number begun status log
    for ((number = 1; number <= test_runs; number++)); do
        log=$work/tests_$number.log begun=$SECONDS status=0
        # In a session of its own, as in a terminal: kernels that share the processors by session give the load as much.
        # Waited for, as a signal to this script is handled only then; what is in the background ignores Ctrl-C.
        (cd "$tree" && exec env --default-signal=INT,QUIT "${user[@]}" setsid setpriv --pdeathsig TERM env "${tests[@]}") \
            > "$log" 2>&1 < /dev/null &
        testing=$!
        wait "$testing" || status=$?
        testing=
        outcome=ok
        if ((status == 0)); then
            succeeded=$((succeeded + 1))
        else
            outcome="FAILED with exit code $status: $(grep -E '^(FAILED|ERROR)[ :]' "$log" || tail -n 1 "$log")"
        fi
        echo "$name, test run $number: $((SECONDS - begun)) s, $outcome"
    done
    echo "$name: $succeeded of $test_runs test runs succeeded"
    ((succeeded == test_runs)) || failed=1
}

((test_runs == 0)) || prepare_tests
stress
under "ordinary user beside stress-ng" "${user[@]}"
((test_runs == 0)) || tests_under "ordinary user beside stress-ng"
end_load
if ((EUID != 0)); then
    echo "root beside bursts of real-time priority: left out, as only root may (sudo $0)"
elif ! chrt -f 10 true 2> /dev/null; then
    echo "root beside bursts of real-time priority: left out, as this machine gives nobody real-time priority"
else
    bursts
    under "root beside bursts" env
fi
exit "$failed"
