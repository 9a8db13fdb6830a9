# Sourced by the commands beside it: sets $root and $python, and brings .venv up to date when it is not.
root=$(cd "$(dirname "$0")/.." && pwd)
python="$root/.venv/bin/python"

# Where no locale is set, Python could not read the path of this checkout if it is not ASCII.
case "$(locale charmap 2>/dev/null)" in
ANSI_X3.4-1968 | US-ASCII | 646) export LC_ALL=C.UTF-8 ;;
esac

prepare() { # $1: an extra of pyproject.toml, or empty
    stamp="$root $(cat "$root/pyproject.toml" "$root/iec61499/pyproject.toml" "$root/constraints.txt" | cksum)"
    if [ "$(cat "$root/.venv/stamp-${1:-run}" 2>/dev/null)" != "$stamp" ] || ! [ -x "$python" ]; then
        if ! command -v python3 >/dev/null; then
            echo "dtwin: python3 is not there: it needs python 3.11 or newer, with venv and pip" >&2
            exit 2
        fi
        python3 "$root/scripts/environment.py" "$1" "$stamp" || exit $?
    fi
}
