# Sourced by the peers' scripts: `peer_venv NAME PACKAGE...` sets $venv to a throw-away virtual environment with these
# packages, made once for each list of them, in /tmp or the folder PEERS_VENV. One that was broken off is begun again.
peer_venv() {
    venv=${PEERS_VENV:-/tmp}/venv-peers-$1
    shift
    if [ ! -x "$venv/bin/python" ] || [ "$(cat "$venv/packages" 2>&1)" != "$*" ]; then
        python3 -m venv --clear "$venv"
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$@"
        echo "$*" > "$venv/packages"
    fi
}

# Stable-Baselines3 in JAX, and what Étude's wheel needs.
sbx_venv() {
    # shellcheck disable=SC2046  # A word a package.
    peer_venv sbx $(grep -v '^#' "$here/../../scripts/sb3-requirements.txt") mujoco==3.17.0 safetensors==0.8.0
}

# RoboPianist, without its dependencies: two of them only make sound and need system libraries (portaudio, fluidsynth).
robopianist_venv() {
    peer_venv robopianist mujoco==3.3.7 dm_control==1.0.34 numpy==2.4.6 \
        dm-env-wrappers==0.0.13 mujoco-utils==0.0.6 note-seq==0.0.5 pretty-midi==0.2.11.post0
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps robopianist==1.0.10
}
