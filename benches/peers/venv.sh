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
