#!/bin/sh
# Runs robopianist_steps.py in a throw-away virtual environment with pinned versions: robopianist.sh [seconds] [threads]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/venv.sh"
peer_venv robopianist mujoco==3.3.7 dm_control==1.0.34 numpy==2.4.6 \
    dm-env-wrappers==0.0.13 mujoco-utils==0.0.6 note-seq==0.0.5 pretty-midi==0.2.11.post0
# Without its dependencies: two of them only make sound and need system libraries (portaudio, fluidsynth).
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps robopianist==1.0.10
exec "$venv/bin/python" -W ignore "$here/robopianist_steps.py" "$@"
