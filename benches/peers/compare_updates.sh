#!/bin/sh
# Our update rate and the peers', interleaved, since machines drift: compare_updates.sh [rounds] [seconds]
# Prints one JSON line a measurement, then medians. Pass PEERS_VENV to use one environment that has both peers.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
rounds=${1:-5}
seconds=${2:-3}
cd "$root"
cargo build --quiet --release -p etude-learn --example update_bench
ours=${CARGO_TARGET_DIR:-target}/release/examples/update_bench
results=$(mktemp)
for round in $(seq "$rounds"); do
    for threads in 1 2; do
        {
            taskset -c "0-$((threads - 1))" "$ours" "$seconds" "$threads"
            "$here/jax_update.sh" "$seconds" "$threads"
            "$here/torch_update.sh" "$seconds" "$threads"
        } | tee -a "$results"
    done
done
python3 - "$results" <<'PYTHON'
import collections, json, statistics, sys
rates = collections.defaultdict(list)
for line in open(sys.argv[1]):
    row = json.loads(line)
    rates[row["peer"], row["threads"]].append(row["updates_per_sec"])
for (peer, threads), values in sorted(rates.items()):
    print(f"{peer:24} {threads} thread(s): median {statistics.median(values):7.1f}/s  ({min(values):.1f} to {max(values):.1f}, n {len(values)})")
PYTHON
rm -f "$results"
