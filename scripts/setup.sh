# shellcheck shell=bash
# Sourced by the other scripts: goes to the repository's root and gives them
#   setup_python [EXTRA]   .venv with the project installed in it; nothing is done when nothing changed
#   setup_drawing          the system's libraries for drawing without a display (EGL, software OpenGL)
# On a fresh Debian only python3 is assumed; what is missing is installed with apt-get where that is allowed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
venv="$PWD/.venv"
export PATH="$venv/bin:$PATH" PIP_DISABLE_PIP_VERSION_CHECK=1

fail() {
    echo "$*" >&2
    exit 2
}

# Install Debian packages as root or with a sudo that asks nothing; false where neither is possible.
apt_install() {
    local sudo=()
    command -v apt-get >/dev/null || return 1
    if [ "$(id -u)" != 0 ]; then
        sudo -n true 2>/dev/null || return 1
        sudo=(sudo -n)
    fi
    echo "installing $*" >&2
    "${sudo[@]}" apt-get update -qq >&2 &&
        "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >&2
}

make_venv() {
    [ ! -x "$venv/bin/pip" ] || return 0
    command -v python3 >/dev/null || fail "python3 is missing: install Python 3.11 or newer"
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "$(python3 -V) is too old: 3.11 or newer is needed"
    if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
        apt_install python3-venv || fail "python3-venv is missing: apt-get install python3-venv"
    fi
    python3 -m venv --clear "$venv" || fail "python3 -m venv $venv failed"
}

setup_python() {
    local extra="${1:-}" stamp want
    make_venv
    stamp="$venv/.installed-${extra:-base}"
    want="$(cksum <pyproject.toml) $(python -V) $PWD"
    if [ ! -f "$stamp" ] || [ "$(cat "$stamp")" != "$want" ]; then
        echo "installing nurbs-ooc${extra:+[$extra]} into .venv" >&2
        python -m pip install --quiet --editable ".${extra:+[$extra]}" || fail "pip could not install nurbs-ooc"
        echo "$want" >"$stamp"
    fi
}

can_draw() {
    python - <<'PYTHON' >/dev/null 2>&1
import moderngl

moderngl.create_context(standalone=True, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1").release()
PYTHON
}

setup_drawing() {
    [ ! -f "$venv/.can-draw" ] || return 0
    if ! can_draw; then
        apt_install libegl1 libgl1 libgl1-mesa-dri ||
            fail "software OpenGL is missing: apt-get install libegl1 libgl1 libgl1-mesa-dri"
        can_draw || fail "no OpenGL context without a display, though libegl1, libgl1 and libgl1-mesa-dri are installed"
    fi
    touch "$venv/.can-draw"
}
