#!/bin/sh
# As sbx_droq.sh, in Étude's world through its Python package, as `make wheel` has built it: sbx_etude.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
wheel=$(ls -t "$here"/../../target/wheels/etude_piano-*.whl 2>/dev/null | head -n 1)
if [ -z "$wheel" ]; then
    echo "there is no wheel in target/wheels: make one with \`make wheel\`" >&2
    exit 1
fi
sbx_venv
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --force-reinstall "$wheel"
exec "$venv/bin/python" -W ignore "$here/sbx_droq.py" "${1:-3}" "${2:-1}" etude
