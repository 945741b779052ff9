# Sourced by the peers' scripts: `peer_venv NAME PACKAGE...` sets $venv to a throw-away virtual environment with these
# packages, made once. PEERS_VENV names another folder for it. An installation that was broken off is begun again.
peer_venv() {
    venv=${PEERS_VENV:-/tmp/venv-peers-$1}
    shift
    if [ ! -x "$venv/bin/python" ] || [ -e "$venv/unfinished" ]; then
        python3 -m venv --clear "$venv"
        touch "$venv/unfinished"
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$@"
        rm "$venv/unfinished"
    fi
}

# Stable-Baselines3 in JAX, and what the worlds need that it learns in.
sbx_venv() {
    peer_venv sbx sbx-rl==0.28.0 stable_baselines3==2.9.2 jax==0.10.2 jaxlib==0.10.2 flax==0.12.8 torch==2.15.0 \
        gymnasium==1.4.0 numpy==2.4.6 mujoco==3.17.0
}

# RoboPianist, without its dependencies: two of them only make sound and need system libraries (portaudio, fluidsynth).
robopianist_venv() {
    peer_venv robopianist mujoco==3.3.7 dm_control==1.0.34 numpy==2.4.6 \
        dm-env-wrappers==0.0.13 mujoco-utils==0.0.6 note-seq==0.0.5 pretty-midi==0.2.11.post0
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps robopianist==1.0.10
}
