#!/bin/sh
# Runs jax_update.py in a throw-away virtual environment with pinned versions: jax_update.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
venv=${PEERS_VENV:-/tmp/venv-peers-jax}
if [ ! -x "$venv/bin/python" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6
fi
exec "$venv/bin/python" "$here/jax_update.py" "$@"
