#!/bin/sh
# Runs sbx_droq.py in a throw-away virtual environment with pinned versions: sbx_droq.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
peer_venv sbx sbx-rl==0.28.0 stable_baselines3==2.9.2 jax==0.10.2 jaxlib==0.10.2 flax==0.12.8 torch==2.15.0 \
    gymnasium==1.4.0 numpy==2.4.6
exec "$venv/bin/python" -W ignore "$here/sbx_droq.py" "$@"
