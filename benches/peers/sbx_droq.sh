#!/bin/sh
# Runs sbx_droq.py in a throw-away virtual environment with pinned versions: sbx_droq.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
sbx_venv
exec "$venv/bin/python" -W ignore "$here/sbx_droq.py" "${1:-3}" "${2:-1}" empty
