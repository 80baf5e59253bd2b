# Sourced by the other scripts: a virtual environment in .venv with locked packages, made once.
# Everything stays inside the clone; pip's cache too. Usage: . scripts/environment.sh LOCK
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1
lock="requirements/$1.txt"
unset PYTHONDONTWRITEBYTECODE  # compiled code is kept: every process here imports a lot
export PIP_CACHE_DIR="$PWD/.cache/pip" PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_WARN_SCRIPT_LOCATION=1

python=""
for candidate in python3.11 python3.12 python3.13 python3; do
  if command -v "$candidate" >/dev/null && "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    python=$candidate
    break
  fi
done
if [ -z "$python" ]; then
  echo "wrenchbed needs Python 3.11 or newer; none was found" >&2
  exit 1
fi

built=(scripts/build_kernel.py src/wrenchbed/robots/compiled/_statics.c)
stamp=".venv/.$1-$(cat "$lock" pyproject.toml "${built[@]}" | sha256sum | cut -c1-16)"
if [ ! -f "$stamp" ]; then
  echo "setting up .venv from $lock (about a minute, once)" >&2
  # one that is there and works stays: another Python would only mix two of them
  if ! .venv/bin/python -c '' 2>/dev/null && ! "$python" -m venv --clear .venv >/dev/null 2>&1; then
    # Debian's Python without python3-venv: the system's pip can fill a bare environment
    rm -rf .venv
    if ! "$python" -m venv --without-pip .venv || ! "$python" -m pip --version >/dev/null 2>&1; then
      echo "this Python can make no virtual environment: install python3-venv (Debian)" >&2
      exit 1
    fi
  fi
  pip=(.venv/bin/python -m pip)
  .venv/bin/python -c 'import pip' 2>/dev/null || pip=("$python" -m pip --python .venv/bin/python)
  "${pip[@]}" install --quiet --no-compile --no-deps --require-hashes -r "$lock" || exit 1  # the lock is complete
  "${pip[@]}" install --quiet --no-deps --no-build-isolation --editable . || exit 1
  rm -f .venv/."$1"-*
  touch "$stamp"
fi
export PATH="$PWD/.venv/bin:$PATH"
