#!/usr/bin/env bash
# Creates the virtual environment that the Makefile uses, from the first Python that is new enough, with uv inside it.
#   tools/create_venv.sh DIRECTORY          PYTHON=/path/to/python overrides the search
set -euo pipefail

venv=${1:?usage: create_venv.sh DIRECTORY}
constraints=$(dirname "$0")/../constraints.txt
wanted='import ensurepip, sys, venv; sys.exit(not (3, 12) <= sys.version_info[:2] < (3, 14))'

candidates() {
    [ -z "${PYTHON:-}" ] || { echo "$PYTHON"; return; }
    printf '%s\n' python3.12 python3.13 python3 python
    # A pyenv shim answers only for the version selected in this folder; its other versions are found here.
    printf '%s\n' "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.1[23]*/bin/python
}

python=
while read -r candidate; do
    if "$candidate" -c "$wanted" >/dev/null 2>&1; then python=$candidate; break; fi
done < <(candidates)

if [ -n "$python" ]; then
    echo "creating $venv with $("$python" --version) ($("$python" -c 'import sys; print(sys.executable)'))"
    "$python" -m venv --clear "$venv"
elif [ -z "${PYTHON:-}" ] && uv --version >/dev/null 2>&1; then
    echo "no Python 3.12 or 3.13 with venv found: letting uv provide one"
    uv venv --seed --clear --python '>=3.12,<3.14' "$venv"
else
    echo "error: needs Python 3.12 or 3.13 with its venv module${PYTHON:+ (PYTHON=$PYTHON is not one)}." \
         "Install one (Debian, Ubuntu: apt install python3.12-venv; or https://docs.astral.sh/uv) and run make again." >&2
    exit 1
fi
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$(grep '^uv==' "$constraints")"
