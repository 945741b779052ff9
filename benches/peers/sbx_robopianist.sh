#!/bin/sh
# As sbx_droq.sh, in RoboPianist's environment: sbx_robopianist.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
robopianist_venv
# Its packages go before those of SBX, which has another MuJoCo.
packages=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
sbx_venv
PYTHONPATH=$packages exec "$venv/bin/python" -W ignore "$here/sbx_droq.py" "${1:-3}" "${2:-1}" robopianist
