#!/bin/sh
# Runs torch_update.py in a throw-away virtual environment with pinned versions:
# torch_update.sh [seconds] [threads] [compile]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
peer_venv torch torch==2.15.0 numpy==2.4.6
exec "$venv/bin/python" "$here/torch_update.py" "$@"
