#!/bin/sh
# Runs rollout.py in a throw-away virtual environment with pinned versions: rollout.sh SECONDS THREADS MODEL.xml TRACE
# `benches/run.py` writes the model and the trace (the torques of one episode of random actions) and runs this.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
[ $# -eq 4 ] || { echo "usage: rollout.sh SECONDS THREADS MODEL.xml TRACE; benches/run.py writes the files" >&2; exit 2; }
peer_venv rollout mujoco==3.17.0 numpy==2.4.6
exec "$venv/bin/python" "$here/rollout.py" "$@"
