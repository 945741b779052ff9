#!/bin/sh
# Runs torch_update.py in a throw-away virtual environment with pinned versions:
# torch_update.sh [seconds] [threads] [compile]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
venv=${PEERS_VENV:-/tmp/venv-peers-torch}
if [ ! -x "$venv/bin/python" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet torch==2.15.0 numpy==2.4.6
fi
exec "$venv/bin/python" "$here/torch_update.py" "$@"
