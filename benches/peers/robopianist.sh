#!/bin/sh
# Runs robopianist_steps.py in a throw-away virtual environment with pinned versions: robopianist.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
robopianist_venv
exec "$venv/bin/python" -W ignore "$here/robopianist_steps.py" "$@"
