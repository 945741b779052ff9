#!/bin/sh
# Runs jax_update.py in a throw-away virtual environment with pinned versions: jax_update.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
peer_venv jax jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6
exec "$venv/bin/python" "$here/jax_update.py" "$@"
