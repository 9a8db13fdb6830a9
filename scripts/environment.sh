# Sourced by the commands beside it: sets $root and $python, and brings .venv up to date when it is not.
root=$(cd "$(dirname "$0")/.." && pwd)
python="$root/.venv/bin/python"

prepare() { # $1: an extra of pyproject.toml, or empty
    stamp=$(cat "$root/pyproject.toml" "$root/constraints.txt" | cksum)
    if [ "$(cat "$root/.venv/stamp-${1:-run}" 2>/dev/null)" != "$stamp" ]; then
        python3 "$root/scripts/environment.py" "$1" "$stamp" || exit $?
    fi
}
