#!/bin/sh
# Runs bare_steps.py in a throw-away virtual environment with pinned versions: bare_steps.sh SECONDS [MODEL.xml]
set -eu
[ $# -eq 1 ] || [ $# -eq 2 ] || { echo "usage: bare_steps.sh SECONDS [MODEL.xml]; etude model export -o MODEL.xml writes it" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
if [ $# -gt 1 ]; then peer_venv rollout mujoco==3.17.0 numpy==2.4.6; else robopianist_venv; fi
exec "$venv/bin/python" -W ignore "$here/bare_steps.py" "$@"
